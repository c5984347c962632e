"""The data process: messages, snapshots and parameters on their way through the link.

`robot` and `cloud` are the two ends, `process` is what they share. `probe` measures the data session, `states` carries
the snapshots of stateful nodes, `parameter_values` the parameters that follow a node.

Never here: whether a message of the cloud reaches an actuator (the collector), and heartbeats. Serves the data process
of both sides.
"""
