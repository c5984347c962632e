"""One RobotOffload on one machine, without a cluster: processes, emulated wire, recorder, report."""
