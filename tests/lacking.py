"""What a test does on a machine that lacks a program."""

from __future__ import annotations

import os
from typing import NoReturn

import pytest


def lacks(reason: str) -> NoReturn:
    """Skips the test with the reason; in CI, where everything must be there, it fails."""
    if os.environ.get("ROBOT_OFFLOAD_CI") == "1":
        pytest.fail(reason)
    pytest.skip(reason)
