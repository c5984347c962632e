"""`kubectl offload bundle`: the folder with all that a robot needs."""
