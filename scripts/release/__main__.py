"""Run as a program: see `scripts.release.main`."""

import sys

from scripts.release.main import main

if __name__ == "__main__":
    sys.exit(main())
