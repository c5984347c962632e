"""The tunnel between two DDS Routers: one TCP connection that the robot opens and both sides prove themselves on.

A process of its own on each side (`robot-offload-tunnel`), without ROS: the router beside it talks plain TCP over the
loopback interface, what leaves the host is TLS.
"""
