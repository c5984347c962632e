"""The data processes: inputs to the cloud, envelopes to the robot, probes."""
