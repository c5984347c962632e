"""The commands of `robot-offload` that need the lab."""
