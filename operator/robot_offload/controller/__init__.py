"""Brings the cluster to what one RobotOffload declares: observe, decide, apply, publish. The only room that writes."""
