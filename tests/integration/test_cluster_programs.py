"""Where the test cluster's programs come from, and what is said when they cannot come."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from robot_offload_lab.cluster import programs
from robot_offload_lab.cluster.errors import ClusterError, NoGoError

ROOT = Path(__file__).parents[2]
WANTED = {"one": "example.invalid/one", "two": "example.invalid/two"}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache; and Go is not installed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    programs.cache().mkdir(parents=True)
    return programs.cache()


def built(cache: Path, go_version: str = "go1.26.0", names: tuple[str, ...] = ("one", "two")) -> Path:
    home = cache / programs._key(go_version)
    home.mkdir(exist_ok=True)
    for name in names:
        (home / name).touch()
    return home


def go_that(cache: Path, *build: str) -> None:
    """Install a Go that knows its version and whose `build` does this; `$2` is the directory for the programs."""
    lines = ["#!/bin/sh", '[ "$1" = env ] && { echo go1.26.0; exit; }', 'while [ "$1" != -o ]; do shift; done', *build]
    go = Path(os.environ["PATH"]) / "go"
    go.write_text("\n".join(lines))
    go.chmod(0o755)
    (go.parent / "nice").symlink_to("/usr/bin/nice")


def unheard(line: str) -> None:
    pytest.fail(f"nothing is to be said, but: {line}")


def test_without_go_and_without_programs_the_next_step_is_told(cache: Path) -> None:
    with pytest.raises(NoGoError, match=r"Install Go .*, then: python -m robot_offload_lab\.cluster build"):
        programs.ensure(unheard, WANTED)


def test_programs_that_are_there_need_no_go(cache: Path) -> None:
    home = built(cache)
    assert programs.ensure(unheard, WANTED) == programs.Programs(home)


def test_half_a_set_is_not_a_set(cache: Path) -> None:
    built(cache, names=("one",))
    with pytest.raises(NoGoError):
        programs.ensure(unheard, WANTED)


def test_programs_of_other_pins_are_not_taken(cache: Path) -> None:
    built(cache).rename(cache / "0123456789abcdef-go1.26.0")
    with pytest.raises(NoGoError):
        programs.ensure(unheard, WANTED)


def test_a_second_run_waits_for_the_build_of_the_first_and_uses_it(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_that(cache, "exit 1")  # it is not asked to build
    said: list[str] = []
    found: list[programs.Programs] = []
    waiting = threading.Event()

    def say(line: str) -> None:
        said.append(line)
        waiting.set()

    second = threading.Thread(target=lambda: found.append(programs.ensure(say, WANTED)))
    with programs._only_one_builds(unheard):
        second.start()
        assert waiting.wait(60)
        home = built(cache)
    second.join(60)
    assert said == ["test cluster: another run is building the programs; waiting for it"]
    assert found == [programs.Programs(home)]


def test_a_build_tells_its_progress_and_keeps_every_program(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    go_that(cache, "echo a/package >&2", "echo another/package >&2", ': > "$2one"', ': > "$2two"')
    monkeypatch.setattr(programs, "REPORT_EVERY", 0.0)
    said: list[str] = []
    home = programs.ensure(said.append, WANTED).directory
    assert sorted(path.name for path in home.iterdir()) == ["one", "two"]
    assert "building one, two from Go modules; once, some ten minutes" in said[0]
    assert "2 packages compiled after" in said[2]
    assert said[-1].startswith("test cluster: built in")
    assert said[-1].endswith(str(home))


def test_a_build_that_fails_says_what_go_said_and_leaves_nothing(cache: Path) -> None:
    go_that(cache, "echo 'one.go:3: undefined: x' >&2", ': > "$2one"', "exit 1")
    with pytest.raises(ClusterError, match=r"one\.go:3: undefined: x"):
        programs.ensure(lambda line: None, WANTED)
    assert [path for path in cache.rglob("*") if path.name in ("one", "two")] == []


def test_what_a_killed_build_left_is_removed(cache: Path) -> None:
    (cache / "partial-abc").mkdir()
    with programs._only_one_builds(unheard):
        assert not (cache / "partial-abc").exists()


@pytest.mark.parametrize(("in_ci", "outcome"), [("0", "1 skipped"), ("1", "1 error")])
def test_without_go_a_test_is_skipped_with_the_reason_and_fails_in_ci(cache: Path, in_ci: str, outcome: str) -> None:
    # The cache fixture has changed the environment: neither Go nor programs are there.
    one = "tests/integration/test_control_plane.py::test_an_object_that_is_applied_can_be_read_back"
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", one],
        cwd=ROOT,
        env={**os.environ, "ROBOT_OFFLOAD_CI": in_ci},
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome in run.stdout
    assert "Install Go" in run.stdout
