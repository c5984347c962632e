"""The robot's own key and certificate: made on the robot, signed in the cluster, renewed while the robot runs."""
