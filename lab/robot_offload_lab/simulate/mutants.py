"""Proof of teeth: faults planted on purpose, each of which the simulation must find.

A mutant replaces functions of the core (or of a model shell, where the rule lives in the shell) while it is `planted`.
The core itself knows nothing of this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from robot_offload_core import collectors, guardians, lease, placement, pulse, switcher
from robot_offload_core.beats import Beat, Permission
from robot_offload_core.collectors import Collector, Gate, Passage
from robot_offload_core.envelope import Envelope
from robot_offload_core.guardians import Guardian
from robot_offload_core.lease import Cloud
from robot_offload_core.placement import CloudBeat, Robot
from robot_offload_core.pulse import Pulse
from robot_offload_core.settings import OutputSpec
from robot_offload_core.token import Site
from robot_offload_lab.simulate.cloud_side import CloudData

Patch = tuple[Any, str, Callable[..., Any]]


@dataclass(frozen=True)
class Mutant:
    """A planted fault: what it is, which invariant is expected to find it, and the functions it replaces."""

    meaning: str
    invariants: tuple[str, ...]
    patches: tuple[Patch, ...]


@contextmanager
def planted(name: str | None) -> Iterator[None]:
    """Plants the mutant `name` (None: none) for the time of the block."""
    patches = MUTANTS[name].patches if name else ()
    originals = [(owner, attribute, getattr(owner, attribute)) for owner, attribute, _ in patches]
    for owner, attribute, function in patches:
        setattr(owner, attribute, function)
    try:
        yield
    finally:
        for owner, attribute, function in originals:
            setattr(owner, attribute, function)


# -- the fence --------------------------------------------------------------------------------------------------------

_offer_cloud, _offer_robot, _set_gate, _start = (
    collectors.offer_cloud, collectors.offer_robot, collectors.set_gate, collectors.start,
)  # fmt: skip


def _any_token(state: Collector, index: int, envelope: Envelope, now_s: float) -> tuple[Collector, Passage]:
    after, passage = _offer_cloud(state, index, envelope, now_s)
    return after, Passage(True, "Current") if passage.reason == "ForeignToken" else passage


def _newer_token(state: Collector, index: int, envelope: Envelope, now_s: float) -> tuple[Collector, Passage]:
    charge = state.charge
    if charge is not None and envelope.token.epoch >= charge.token.epoch:
        following = state.next.token if state.next else None
        token = charge.token if envelope.token != following else envelope.token
        if charge.site is Site.ROBOT and envelope.token != following:
            return state, Passage(True, "Current")
        envelope = replace(envelope, token=token)
    return _offer_cloud(state, index, envelope, now_s)


def _no_sequence(state: Collector, index: int, envelope: Envelope, now_s: float) -> tuple[Collector, Passage]:
    after, passage = _offer_cloud(state, index, envelope, now_s)
    return after, Passage(True, "Current") if passage.reason == "Reordered" else passage


def _ageless(outputs: tuple[OutputSpec, ...], _max_age_s: float, gate_timeout_s: float) -> Collector:
    return _start(outputs, float("inf"), gate_timeout_s)


def _patient(outputs: tuple[OutputSpec, ...], max_age_s: float, _gate_timeout_s: float) -> Collector:
    return _start(outputs, max_age_s, float("inf"))


def _forgetful(state: Collector, *_kept: object) -> Collector:
    return state


def _unstamped(state: Collector, gate: Gate, now_s: float) -> Collector:
    return _set_gate(state, replace(gate, said_s=None), now_s)


def _any_flow(_output: object, _now_s: float) -> bool:
    return True


def _backwards(state: Collector, gate: Gate, now_s: float) -> Collector:
    if state.charge is not None and gate.current.token.epoch < state.charge.token.epoch:
        return replace(state, charge=gate.current, next=gate.next, gate_s=now_s)
    return _set_gate(state, gate, now_s)


# -- the lease --------------------------------------------------------------------------------------------------------

_hear, _speak, _compose = lease._hear, pulse.speak, pulse.compose


def _from_arrival(cloud: Cloud, beat: Beat, arrived_s: float, now_s: float) -> Cloud:
    before_s = cloud.lease_end_s
    cloud = _hear(cloud, beat, arrived_s, now_s)
    body = beat.body
    granted = isinstance(body, Permission) and body.granted and body.cloud == cloud.incarnation
    if granted and body.epoch == cloud.epoch:  # type: ignore[union-attr]
        return replace(cloud, lease_end_s=max(before_s, arrived_s + cloud.settings.lease_s))
    return cloud


def _vouching(state: Pulse, now_s: float, wall_us: int) -> tuple[Pulse, Beat]:
    spoken = state if state.spoken_s is None else replace(state, spoken_s=now_s)
    after, beat = _compose(spoken, now_s, wall_us)
    return replace(after, spoken_s=state.spoken_s), beat


def _open_gate(data: CloudData) -> bool:
    return data.token is not None


# -- deciding ---------------------------------------------------------------------------------------------------------

_tell, _take_over, _core_rule, _robot_hear = (
    switcher._tell, switcher._take_over, guardians._core_rule, switcher._hear,
)  # fmt: skip


def _any_beat(robot: Robot, event: CloudBeat, now_s: float) -> Robot:
    robot = _robot_hear(robot, event, now_s)
    if event.beat.incarnation != robot.link.peer or event.beat.echo is not None:
        return robot
    good = replace(robot.situation, good_s=event.arrived_s)
    return replace(robot, situation=good, link=replace(robot.link, echo_sent_s=event.arrived_s))


def _stall_blind(robot: Robot, now_s: float) -> Robot:
    return replace(robot, stepped_s=now_s)


def _hasty_effects(robot: Robot, _now_s: float) -> Site | None:
    return switcher.site(robot)


def _same_epoch(robot: Robot, *arguments: Any) -> Robot:
    after = _take_over(robot, *arguments)
    return replace(after, epoch=robot.epoch, last_epoch=robot.last_epoch)


def _break_before_make(robot: Robot, now_s: float, commands: list[Any]) -> Robot:
    after = _tell(robot, now_s, commands)
    for index, command in enumerate(commands):
        if isinstance(command, placement.SetGate) and command.gate.next is not None:
            commands[index] = placement.SetGate(replace(command.gate, current=command.gate.next, next=None))
    return after


def _no_release(state: Guardian, now_s: float, commands: list[guardians.Command]) -> Guardian:
    after = _core_rule(state, now_s, commands)
    commands[:] = [c for c in commands if not isinstance(c, guardians.Inhibit) or c.inhibit]
    return after


def _no_inhibit(state: Guardian, now_s: float, commands: list[guardians.Command]) -> Guardian:
    after = _core_rule(state, now_s, commands)
    commands[:] = [c for c in commands if not isinstance(c, guardians.Inhibit) or not c.inhibit]
    return after


MUTANTS: dict[str, Mutant] = {
    "fence-off": Mutant(
        "the collector passes any token", ("1a", "1b", "1c"), ((collectors, "offer_cloud", _any_token),)
    ),
    "newer-for-equal": Mutant(
        "the collector takes a newer epoch for the current one", ("1a", "1c"),
        ((collectors, "offer_cloud", _newer_token),),
    ),
    "no-sequence": Mutant(
        "the collector does not look at sequences", ("1b",), ((collectors, "offer_cloud", _no_sequence),)
    ),
    "no-age": Mutant("the collector does not look at ages", ("1d",), ((collectors, "start", _ageless),)),
    "no-fallback": Mutant(
        "the collector trusts a control that has fallen silent", ("1c", "7"), ((collectors, "start", _patient),)
    ),
    "no-memory": Mutant(
        "a restarted collector forgets what it had reached", ("1a", "1b", "7"), ((collectors, "resume", _forgetful),)
    ),
    "gate-by-arrival": Mutant(
        "a gate counts from when it was read", ("1c", "7"), ((collectors, "set_gate", _unstamped),)
    ),
    "partial-changeover": Mutant(
        "the collector changes over before all outputs flow", ("4", "1a"), ((collectors, "_flows", _any_flow),)
    ),
    "goes-back": Mutant("the collector goes back to an older epoch", ("1a",), ((collectors, "set_gate", _backwards),)),
    "lease-from-arrival": Mutant(
        "the lease is counted from the arrival of the grant", ("2", "7"), ((lease, "_hear", _from_arrival),)
    ),
    "pulse-vouches": Mutant(
        "grants go on although control is silent", ("vouching",), ((pulse, "compose", _vouching),)
    ),
    "no-egress-check": Mutant(
        "the lease is not checked for each message that leaves", ("2", "7"), ((CloudData, "may_leave", _open_gate),)
    ),
    "bare-beats-good": Mutant(
        "a beat without content counts as good", ("3a",),
        ((switcher, "_hear", _any_beat),),
    ),
    "no-stall-grace": Mutant(
        "a stall of our own is taken for silence", ("3c",), ((switcher, "_notice_stall", _stall_blind),)
    ),
    "hasty-effects": Mutant(
        "effects of the robot do not wait for the end of the lease", ("7",),
        ((switcher, "effects_site", _hasty_effects),),
    ),
    "same-epoch": Mutant(
        "a take-over keeps the epoch", ("1a", "1c", "3b", "5"), ((switcher, "_take_over", _same_epoch),)
    ),
    "break-before-make": Mutant(
        "the old side is cut before the new one flows", ("4", "3b"), ((switcher, "_tell", _break_before_make),)
    ),
    "never-released": Mutant("the inhibit is never released", ("5", "3d"), ((guardians, "_core_rule", _no_release),)),
    "never-inhibited": Mutant("the driver is never inhibited", ("3b",), ((guardians, "_core_rule", _no_inhibit),)),
}  # fmt: skip
