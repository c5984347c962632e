"""`python -m robot_offload_sim`."""

from robot_offload_sim.main import app

app(prog_name="make simulate")
