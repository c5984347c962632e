"""What this machine lacks for `make test`: the tests that are skipped for it, and the command that helps."""

from __future__ import annotations

import shutil
from typing import Final

PROGRAMS: Final = (
    (("go",), "the API server's tests", "install Go 1.26: https://go.dev/doc/install"),
    (
        ("chromium-headless-shell", "chromium", "google-chrome"),
        "the console's tests",
        "apt-get install chromium-headless-shell",
    ),
)
"""Programs of which one must be there, the tests that need it, and how to get it."""
REST: Final = "make test-all runs the rest: more of the API server, clusters with nodes, ROS, faults in virtual time"


def main() -> None:
    """Print one line for each missing program, then what the other targets run."""
    for names, tests, cure in PROGRAMS:
        if not any(shutil.which(name) for name in names):
            print(f"skipped: {tests}, for want of {names[0]}; {cure}")  # noqa: T201 - its purpose
    print(REST)  # noqa: T201 - its purpose


if __name__ == "__main__":
    main()
