"""The ROS shell: nodes, raw topics, services. rclpy is imported here and in `link/ros.py` only."""
