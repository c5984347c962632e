"""What the agent is told and keeps: parameters, override, offered and adopted settings, notes, files of the cluster."""
