"""`python -m robot_offload.bench`."""

from robot_offload.bench.main import app

app()
