"""`python -m robot_offload` is the command `robot-offload`."""

from robot_offload.cli.main import app

if __name__ == "__main__":
    app(prog_name="robot-offload")
