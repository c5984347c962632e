"""The control processes: the deciding machines with the ROS nodes around them."""
