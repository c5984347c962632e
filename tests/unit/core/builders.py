"""Readable builders of worlds, beats and states: a test says only what is special about its case.

Every builder gives a complete and consistent value of a world in which all is well; the keywords change single fields.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import hypothesis

from robot_offload_core.control.robot.health import Situation
from robot_offload_core.control.robot.placement import IN_CHARGE, Command, Preparation, Robot, Stalls
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.grant import Grant
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.link import links
from robot_offload_core.link.links import Link
from robot_offload_core.link.policies import Policy
from robot_offload_core.words.beats import Beat, CloudReport, Echo, Permission
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import InputSpec, Settings

UID = "wheelchair-7"
ROBOT = "a" * 32
CLOUD = "c" * 32
STRANGER = "5" * 32
NOW_S = 1000.0
STARTED_S = 500.0
SETTINGS = Settings()
BEAT_S = SETTINGS.beat_period_s
PERIODS_S = (SETTINGS.robot_period_s, SETTINGS.cloud_period_s)
SCAN = InputSpec("scan", 0.300)
LEASE_US = round(SETTINGS.lease_s * 1e6)

many = hypothesis.settings(
    deadline=None, max_examples=100, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)  # a shared machine may stand still in the middle of an example; that says nothing about the core
few = hypothesis.settings(many, max_examples=25)


def us(time_s: float) -> int:
    """Microseconds."""
    return round(time_s * 1e6)


# -- beats ------------------------------------------------------------------------------------------------------------


def report(**changes: Any) -> CloudReport:
    """Of a cloud that serves our robot, sleeps, and hears everything."""
    asleep = CloudReport(serves=ROBOT, epoch=0, acting=False, ready=False, data_age_us=10_000, input_ages_us=(50_000,))
    return replace(asleep, **changes)


def acting_report(epoch: int, **changes: Any) -> CloudReport:
    """Of a cloud that acts under `epoch`."""
    return report(epoch=epoch, acting=True, ready=True, **changes)


def permission(epoch: int = 4, **changes: Any) -> Permission:
    """A grant of `epoch` to our cloud."""
    return replace(Permission(epoch, True, CLOUD, LEASE_US), **changes)


def cloud_beat(sent_s: float = NOW_S - 0.005, echo_s: float | None = NOW_S - 0.010, **changes: Any) -> Beat:
    """A beat of our cloud, sent at `sent_s` of a clock that equals the robot's.

    It echoes the robot's beat of `echo_s`, which arrived half-way between the two times.
    """
    echo = None
    if echo_s is not None:
        echo = Echo(ROBOT, us(echo_s) // 20_000, us(echo_s), us((sent_s - echo_s) / 2))
    beat = Beat(UID, Site.CLOUD, CLOUD, us(sent_s) // 20_000, us(sent_s), 0, 1_000, echo, report())
    return replace(beat, **changes)


def robot_beat(sent_s: float = NOW_S - 0.005, echo_s: float | None = NOW_S - 0.010, **changes: Any) -> Beat:
    """A beat of our robot with a grant, which echoes the cloud's beat of `echo_s` on the cloud's clock."""
    echo = None if echo_s is None else Echo(CLOUD, us(echo_s) // 20_000, us(echo_s), 0)
    beat = Beat(UID, Site.ROBOT, ROBOT, us(sent_s) // 20_000, us(sent_s), 0, 1_000, echo, permission())
    return replace(beat, **changes)


def good_link(now_s: float = NOW_S, round_trip_s: float = 0.010) -> Link:
    """A link on which ten beats have arrived, the last one at `now_s`."""
    link = Link()
    for back in reversed(range(10)):
        arrived_s = now_s - back * BEAT_S
        beat = cloud_beat(arrived_s - round_trip_s / 2, arrived_s - round_trip_s)
        assert beat.echo is not None
        beat = replace(beat, echo=replace(beat.echo, hold_us=0))
        link = links.hear(link, beat, ROBOT, arrived_s, 0)
    return link


# -- the robot's side -------------------------------------------------------------------------------------------------


def charge(site: Site, epoch: int, cloud: str = CLOUD) -> Charge:
    """A stay of `site` in charge under `epoch`, named by our robot."""
    return Charge(site, Token(ROBOT, epoch, cloud if site is Site.CLOUD else ""))


def gate_report(site: Site, epoch: int, **changes: Any) -> GateReport:
    """Of a collector that passes `site` under `epoch`, with the outputs of both sides flowing."""
    return replace(GateReport(charge(site, epoch), fell_back=False, robot_flows=True, cloud_flows=True), **changes)


def situation(phase: Phase = Phase.ROBOT, now_s: float = NOW_S, **changes: Any) -> Situation:
    """Everything that control is told, all well and fresh, while the robot is in `phase`."""
    epoch, candidate = EPOCHS[phase]
    told = report()
    if IN_CHARGE[phase] is Site.CLOUD:
        told = acting_report(epoch)
    elif phase is Phase.TO_CLOUD:
        told = report(epoch=candidate)
    well = Situation(
        report=told,
        control_age_s=0.001,
        good_s=now_s - 0.001 if IN_CHARGE[phase] is Site.CLOUD else None,
        pulse_s=now_s - 0.001,
        gate=gate_report(IN_CHARGE[phase], epoch),
        gate_s=now_s - 0.001,
        data_connected=True,
        data_cloud=CLOUD,
        data_heard_s=now_s - 0.010,
        data_s=now_s - 0.001,
    )
    return replace(well, **changes)


EPOCHS = {
    Phase.ROBOT: (3, 0),
    Phase.TO_CLOUD: (3, 4),
    Phase.CLOUD: (4, 0),
    Phase.TO_ROBOT: (4, 5),
    Phase.TAKEOVER: (5, 0),
}
"""Phase -> (epoch in charge, candidate) of the robots built here."""


def robot_in(phase: Phase = Phase.ROBOT, now_s: float = NOW_S, **changes: Any) -> Robot:
    """A robot that has been in `phase` for a while, in a world in which all is well.

    Changes of fields of the grant, the preparation and the stalls are taken as changes of these.
    """
    epoch, candidate = EPOCHS[phase]
    parts = {key: changes.pop(key) for key in ("deadline_s", "armed", "need") if key in changes}
    preparation = replace(Preparation(now_s + 0.650), **parts) if candidate else None
    granted = Grant(
        ROBOT, now_s - 90.0, IN_CHARGE[phase], epoch, max(epoch, candidate), candidate,
        offered=bool(preparation and preparation.armed), cloud="" if phase is Phase.ROBOT else CLOUD,
    )  # fmt: skip
    named = ("clear_s", "epoch", "last_epoch", "candidate", "offered", "cloud")
    granted = replace(granted, **{key: changes.pop(key) for key in named if key in changes})
    stepped_s = changes.pop("stepped_s", now_s - 0.010)
    robot = Robot(
        grant=granted,
        started_us=us(STARTED_S),
        settings=SETTINGS,
        inputs=(SCAN,),
        link=good_link(now_s),
        policy=Policy(updated_s=now_s - 0.010),
        phase=phase,
        since_s=now_s - 0.100,
        charged_s=now_s - 100.0,
        preparation=preparation,
        situation=situation(phase, now_s),
        nodes_ready=phase not in (Phase.CLOUD, Phase.TO_ROBOT, Phase.TAKEOVER),
        stalls=Stalls(stepped_s),
        decided=Verdict(IN_CHARGE[phase], Reason.STARTING, "Put there by the test"),
        decided_s=now_s - 100.0,
    )
    return replace(robot, **changes)


def only(commands: list[Command], kind: type[Any]) -> Any:
    """The one command of its kind."""
    found = [command for command in commands if isinstance(command, kind)]
    assert len(found) == 1, f"{len(found)} of {kind.__name__} in {commands}"
    return found[0]


def none_of(commands: list[Command], kind: type[Any]) -> bool:
    """Whether no command of this kind was given."""
    return not any(isinstance(command, kind) for command in commands)
