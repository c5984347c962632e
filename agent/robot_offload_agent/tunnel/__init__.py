"""The tunnel between two DDS Routers: one TCP connection that the robot opens and on which both sides authenticate.

A separate process on each side (`robot-offload-tunnel`), without ROS: the router beside it uses plain TCP over the
loopback interface; what leaves the host is TLS.
"""
