"""What the agent's processes decide, one module each: used by the agent's shells and by the simulation alike.

Each class gets what it may do as arguments (send, publish, the time); sockets, threads, ROS and files are the shell's.
"""
