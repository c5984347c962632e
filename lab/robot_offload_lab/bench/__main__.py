"""`python -m robot_offload_lab.bench`."""

import typer

from robot_offload_lab.bench.main import bench

typer.run(bench)
