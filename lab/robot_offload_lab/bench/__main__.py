"""`python -m robot_offload_lab.bench`."""

from robot_offload_lab.bench.main import app

app()
