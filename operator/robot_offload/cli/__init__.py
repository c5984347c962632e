"""The command line `robot-offload` and its sub-commands."""
