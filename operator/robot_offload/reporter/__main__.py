"""`python -m robot_offload.reporter` is what the container runs."""

from robot_offload.reporter.main import main

if __name__ == "__main__":
    main()
