"""Recordings in a common format: what the robot's agent publishes and what its outputs carry, as MCAP files."""
