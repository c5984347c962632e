"""`robot-offload dockerfile` and `build`."""
