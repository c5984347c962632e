"""A running ROS graph, what of it can be shared with the cloud, and the RobotOffload that declares it."""
