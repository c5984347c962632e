"""What the robot does with settings that the cloud offers: judge, keep, then answer and put them in force."""

from __future__ import annotations

import queue
from collections.abc import Callable
from pathlib import Path

import pytest

from robot_offload_agent.settings import store
from robot_offload_agent.settings.adopted import RobotSettings
from robot_offload_agent.settings.notes import CloudNotes, RobotNotes, decode_robot, encode
from robot_offload_agent.settings.offer import Offer
from robot_offload_agent.settings.parameters import Configuration, parse
from robot_offload_core.fence.token import Site

OFFER = Offer(4, {"pin": "Robot"})
WORSE = Offer(5, {"lease_ms": 9000.0})
PATIENCE_S = 60.0


class Robot:
    """RobotSettings with a deciding thread that is the test."""

    def __init__(self, configuration: Configuration) -> None:
        self.posted: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self.adopted: list[int] = []
        self.settings = RobotSettings(configuration, self.posted.put, self._adopt)

    def _adopt(self, _now: float) -> None:
        self.adopted.append(self.settings.generation)

    def offered(self, *offers: Offer) -> None:
        for offer in offers:
            self.settings.take(encode(CloudNotes(offer)))
        for _ in offers:
            self.posted.get(timeout=PATIENCE_S)(0.0)

    @property
    def said(self) -> RobotNotes:
        return decode_robot(self.settings.notes("", Site.ROBOT, "LinkGood", "good"))


@pytest.fixture
def local(tmp_path: Path) -> Configuration:
    return parse({"side": "robot", "uid": "walker-1", "state_dir": str(tmp_path / "state"), "generation": 3})


def test_what_is_taken_is_on_the_disk_before_it_is_answered_and_in_force(local: Configuration) -> None:
    robot = Robot(local)
    robot.settings.take(encode(CloudNotes(OFFER)))
    assert robot.said.digest == ""
    robot.posted.get(timeout=PATIENCE_S)(0.0)
    said = robot.said
    assert (said.digest, said.accepted, said.reason, said.generation) == (OFFER.digest, True, "Accepted", 4)
    assert robot.adopted == [4]
    assert robot.settings.present["pin"] == "Robot"
    assert Robot(local).said.digest == OFFER.digest, "the next start answers before it is asked"


def test_a_refusal_is_answered_and_changes_nothing_in_force_or_on_the_disk(local: Configuration) -> None:
    robot = Robot(local)
    robot.offered(OFFER)
    robot.offered(WORSE)
    said = robot.said
    assert (said.digest, said.accepted, said.reason, said.generation) == (WORSE.digest, False, "HardLimit", 4)
    assert robot.settings.problem is not None
    assert robot.settings.problem[0] == "SettingsRefused"
    assert robot.settings.present["pin"] == "Robot"
    assert store.load(local)[1] == OFFER


def test_an_offer_is_judged_once(local: Configuration) -> None:
    robot = Robot(local)
    robot.offered(WORSE)
    robot.settings.take(encode(CloudNotes(WORSE)))
    assert robot.posted.empty()


def test_settings_that_cannot_be_kept_are_not_in_force_until_they_can(local: Configuration) -> None:
    obstacle = Path(local["state_dir"])
    obstacle.write_text("a file where the folder should be")
    robot = Robot(local)
    robot.offered(OFFER)
    assert (robot.said.accepted, robot.said.reason, robot.said.generation) == (False, "NotKept", 3)
    assert "free the disk" in robot.said.message
    assert robot.settings.present["pin"] == "Auto"
    obstacle.unlink()
    robot.offered(OFFER)
    assert (robot.said.accepted, robot.said.reason, robot.said.generation) == (True, "Accepted", 4)


def test_notes_that_are_none_change_nothing(local: Configuration) -> None:
    robot = Robot(local)
    assert robot.settings.take("{") == ""
    assert robot.posted.empty()
    assert robot.settings.take(encode(CloudNotes(leaving="end"))) == "end"


def test_damaged_kept_settings_are_a_problem_and_no_answer(local: Configuration) -> None:
    path = store.path(local)
    path.parent.mkdir()
    path.write_text("{")
    robot = Robot(local)
    assert robot.settings.problem is not None
    assert robot.settings.problem[0] == "KeptSettingsDamaged"
    assert robot.said.digest == ""
    robot.offered(OFFER)
    assert robot.settings.problem is None
