"""`python -m robot_offload.simulate`."""

from robot_offload.simulate.main import app

app(prog_name="make simulate")
