"""Processes that are to end with whoever started them."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from robot_offload_lab.cluster.processes import bond

pytestmark = pytest.mark.skipif(shutil.which("setpriv") is None, reason="there is no setpriv here")


def test_a_program_begins_under_the_parent_that_started_it_and_ends_where_that_one_is_dead_already() -> None:
    *words, parent = bond(True)
    assert subprocess.run([*words, parent, "true"], check=False).returncode == 0
    assert subprocess.run([*words, "1", "true"], check=False).returncode == 1
    assert bond(False) == []
