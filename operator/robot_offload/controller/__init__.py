"""Brings the cluster to what one RobotOffload declares: observe, decide, apply, publish. Only this package writes."""
