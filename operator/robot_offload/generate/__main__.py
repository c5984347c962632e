"""`python -m robot_offload.generate`."""

import sys

from robot_offload.generate.main import main

if __name__ == "__main__":
    sys.exit(main())
