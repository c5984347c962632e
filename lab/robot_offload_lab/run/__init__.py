"""Starts one RobotOffload on one machine, without a cluster: programs, processes, certificates, the demo."""
