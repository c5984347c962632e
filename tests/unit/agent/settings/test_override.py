"""The maintenance override: kept over restarts, expired on the system clock, never half set."""

import json
from pathlib import Path

import pytest

from robot_offload_agent.settings import override as overrides
from robot_offload_agent.settings.override import Override
from robot_offload_agent.settings.parameters import Configuration, parse
from robot_offload_core.fence.token import Site


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    return parse({"side": "robot", "uid": "walker-1", "state_dir": str(tmp_path / "state")})


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The system clock, in the hands of the test."""
    clock = [1000.0]
    monkeypatch.setattr(overrides, "_wall_s", lambda: clock[0])
    return clock


def test_none_is_set_at_first(configuration: Configuration) -> None:
    override = Override(configuration)
    assert override.word == "Auto"
    assert override.wish(5.0) is None


@pytest.mark.parametrize(("word", "site"), [("Robot", Site.ROBOT), ("Cloud", Site.CLOUD)])
def test_an_override_without_an_end_is_kept_over_a_restart(configuration: Configuration, word: str, site: Site) -> None:
    Override(configuration).set(word, 0.0)
    wish = Override(configuration).wish(5.0)
    assert wish is not None
    assert (wish.site, wish.until_s) == (site, None)


def test_an_override_with_an_end_ends_also_while_nothing_runs(configuration: Configuration, wall: list[float]) -> None:
    Override(configuration).set("Cloud", 60.0)
    wall[0] += 20.0
    wish = Override(configuration).wish(5.0)
    assert wish is not None
    assert wish.until_s == pytest.approx(45.0)
    wall[0] += 40.0
    assert Override(configuration).word == "Auto"


def test_the_end_is_told_once(configuration: Configuration, wall: list[float]) -> None:
    override = Override(configuration)
    override.set("Cloud", 60.0)
    assert not override.expire()
    wall[0] += 61.0
    assert override.expire()
    assert not override.expire()
    assert override.wish(5.0) is None


def test_auto_takes_it_back_for_good(configuration: Configuration) -> None:
    Override(configuration).set("Robot", 0.0)
    Override(configuration).set("Auto", 60.0)
    assert Override(configuration).word == "Auto"


DAMAGED = (
    "",
    "{",
    "[]",
    "null",
    '{"override": "Moon", "until": null}',
    '{"override": "Robot"}',
    '{"override": "Robot", "until": "tomorrow"}',
)


@pytest.mark.parametrize("content", DAMAGED)
def test_a_damaged_file_is_no_override(configuration: Configuration, content: str) -> None:
    path = overrides.state_dir(configuration) / "override.json"
    path.parent.mkdir(parents=True)
    path.write_text(content)
    assert Override(configuration).word == "Auto"


def test_an_override_that_cannot_be_kept_is_not_set(configuration: Configuration) -> None:
    overrides.state_dir(configuration).write_text("a file where the folder should be")
    override = Override(configuration)
    with pytest.raises(OSError, match="exists"):
        override.set("Robot", 0.0)
    assert override.word == "Auto"


def test_the_file_is_replaced_as_a_whole(configuration: Configuration) -> None:
    Override(configuration).set("Robot", 0.0)
    folder = overrides.state_dir(configuration)
    assert [path.name for path in folder.iterdir()] == ["override.json"]
    assert json.loads((folder / "override.json").read_text())["override"] == "Robot"


def test_without_a_parameter_the_state_folder_is_the_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    plain = parse({"side": "robot", "uid": "walker-1"})
    assert overrides.state_dir(plain) == tmp_path / "robot-offload" / "walker-1"
