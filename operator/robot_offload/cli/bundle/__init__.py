"""`kubectl offload bundle`: write the folder with everything that a robot needs."""
