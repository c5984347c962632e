"""`python -m robot_offload_lab.simulate`."""

from robot_offload_lab.simulate.main import app

app(prog_name="make simulate")
