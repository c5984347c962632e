"""`kubectl offload status` and `explain`."""
