"""What the robot's data process reports to control: at once what is new, and what goes on with the cloud's probes."""

from __future__ import annotations

from robot_offload_core.data import probe, process
from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.process import DataPlan, OutputPlan
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.topics import pauses
from robot_offload_core.words.events import DataReported, SetEgress
from robot_offload_core.words.messages import DataStatus, Egress, Orders
from robot_offload_core.words.settings import OutputSpec, While
from tests.unit.core.data.test_probes import CLOUD, ROBOT, Side

STEP_S = 0.005
SLACK_S = 0.010
"""As the shell's."""


class Ports(Side):
    """Keeps when control was told something, and whether that woke it."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[tuple[float, bool, DataStatus]] = []
        self.connected = True

    def send(self, to: str, message: object) -> bool:
        self._note(True, message)
        return True

    def renew(self, to: str, message: object) -> bool:
        self._note(False, message)
        return True

    def _note(self, woke: bool, message: object) -> None:
        if isinstance(message, DataStatus):
            self.told.append((self.time_s, woke, message))

    def link_status(self) -> tuple[bool, str]:
        return self.connected, ""


class World:
    """A robot's data process whose thread wakes when something is due, and the probes of a cloud."""

    def __init__(self, *outputs: OutputPlan) -> None:
        self.ports, cloud = Ports(), Side()
        self.process = RobotDataProcess(DataPlan((), outputs), self.ports)
        self.process.handle(Orders(ROBOT, 1))
        self.cloud = CloudDataProcess(DataPlan((), ()), cloud)
        self.cloud.handle(Egress(CLOUD, ROBOT, SetEgress(None, 0.0), ()))
        self.side, self.probe_s = cloud, self.ports.time_s
        self.wakes: list[float] = []

    def run(self, for_s: float, *, probes: bool = True) -> list[tuple[float, bool, DataStatus]]:
        """Lets time pass; returns what control was told."""
        self.ports.told.clear()
        for _ in range(round(for_s / STEP_S)):
            self.ports.time_s = now_s = self.ports.time_s + STEP_S
            self.side.time_s = now_s
            if now_s >= self.probe_s:
                self.probe_s = now_s + probe.PROBE_PERIOD_S
                self.side.crossed.clear()
                self.cloud.turn()
                for payload in self.side.crossed if probes else ():
                    self.process.arrived("probe", b"-", payload)
            if now_s >= self.process.due_s + SLACK_S:
                self.wakes.append(now_s)
                self.process.woke()
                self.process.turn()
        return list(self.ports.told)


def reported(status: DataStatus) -> DataReported:
    assert status.report is not None
    return status.report


def test_what_goes_on_is_reported_with_each_probe_and_wakes_nobody() -> None:
    world = World()
    world.run(1.0)
    told = world.run(2.0)
    assert 18 <= len(told) <= 22
    assert not any(woke for _, woke, _ in told)
    ages_s = [reported(status).age_s for _, _, status in told]
    assert all(age_s is not None and age_s <= process.STATUS_PERIOD_S for age_s in ages_s), "the newest probe has come"


def test_the_thread_gives_signs_of_life_lest_a_wait_looks_like_a_pause() -> None:
    world = World()
    world.run(3.0)
    gaps_s = [after - before for before, after in zip(world.wakes, world.wakes[1:], strict=False)]
    assert max(gaps_s) <= pauses.LIMIT_S / 2 + STEP_S
    assert len(world.wakes) <= 3.0 / process.SIGN_S * 1.3


def test_silence_of_the_cloud_is_followed_closely() -> None:
    world = World()
    world.run(1.0)
    told = world.run(1.0, probes=False)
    assert len([at_s for at_s, _, _ in told]) >= 15


def test_news_wakes_control_at_once() -> None:
    world = World()
    world.run(1.0)
    world.ports.connected = False
    told = world.run(0.2)
    assert [reported(status).connected for _, woke, status in told if woke] == [False]
    world.process.handle(Orders(ROBOT, 2, preparing=2))
    told = world.run(0.06)
    assert told[0][1]
    assert told[0][2].states[0].epoch == 2
    assert len(world.run(1.0)) >= 17, "while a side gets ready as often as ever"


def test_who_must_know_when_an_output_is_to_speak_is_told_as_often_as_ever() -> None:
    spec = OutputSpec("command", 0.3, while_=While(topic="/joy", within_s=0.1))
    world = World(OutputPlan("command", 0.3, spec=spec))
    world.run(1.0)
    told = world.run(1.0)
    assert len(told) >= 17
