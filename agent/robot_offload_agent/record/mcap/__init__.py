"""Recordings in the format of the field: what the robot's agent publishes and what its outputs carry, as MCAP files."""
