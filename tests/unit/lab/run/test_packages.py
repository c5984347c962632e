"""Executables of ROS packages are found by the ament index, and what is missing is said."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload_lab.run.packages import PREFIXES, NotInstalledError, executable
from robot_offload_lab.run.system import NotRunnableError, check_runnable
from tests.unit.specs import changed


def built(prefix: Path, package: str, *names: str) -> Path:
    """A prefix as `colcon build` leaves it."""
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True, exist_ok=True)
    (index / package).touch()
    folder = prefix / "lib" / package
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).touch(0o755)
    return prefix


def sourced(*prefixes: Path) -> dict[str, str]:
    return {PREFIXES: os.pathsep.join(map(str, prefixes))}


def test_the_first_workspace_that_has_the_package_counts(tmp_path: Path) -> None:
    overlay = built(tmp_path / "overlay", "planner", "server")
    underlay = built(tmp_path / "underlay", "planner", "server")
    built(underlay, "controller", "server")
    where = sourced(overlay, underlay)
    assert executable("planner", "server", where) == overlay / "lib" / "planner" / "server"
    assert executable("controller", "server", where) == underlay / "lib" / "controller" / "server"


def test_what_is_missing_is_said_with_the_next_step(tmp_path: Path) -> None:
    where = sourced(built(tmp_path, "planner", "server", "tuner"))
    (tmp_path / "lib" / "planner" / "notes.txt").touch(0o644)
    with pytest.raises(NotInstalledError, match=r"AMENT_PREFIX_PATH is empty.*source the setup\.bash"):
        executable("planner", "server", {})
    with pytest.raises(NotInstalledError, match=r"none of the 1 folders .* has the package 'map'; build it"):
        executable("map", "server", where)
    with pytest.raises(NotInstalledError, match=r"has no executable 'sever'; it has server, tuner$"):
        executable("planner", "sever", where)


def test_a_package_without_executables_says_none(tmp_path: Path) -> None:
    where = sourced(built(tmp_path, "messages"))
    (tmp_path / "lib" / "messages").rmdir()
    with pytest.raises(NotInstalledError, match="it has none"):
        executable("messages", "server", where)


def test_a_run_names_the_node_whose_package_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PREFIXES, str(built(tmp_path, "corridor", "controller")))
    run = {"package": "corridor", "executable": "controler"}
    offload = parse_object(changed("spec.nodes.1.run", run), "spec.yaml")
    with pytest.raises(NotRunnableError, match=r"spec\.yaml: spec\.nodes\[1\]\.run: .*it has controller"):
        check_runnable(offload, Path("spec.yaml"))
