"""`python -m robot_offload.reporter`: the container's command."""

from robot_offload.reporter.main import main

if __name__ == "__main__":
    main()
