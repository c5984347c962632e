"""The cloud agent's work for the operator: offers settings to the robot, hands over, reports the state. Pure.

State in, event, state out; the shell (`cluster_files.py`) reads and writes the files, the control process carries the
notes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from robot_offload_agent.settings.notes import CloudNotes, Credential, RobotNotes
from robot_offload_agent.settings.offer import Answer, Offer
from robot_offload_core.link.links import Health
from robot_offload_core.link.momentary import Glance
from robot_offload_core.words.events import assert_never

LEAVING_S = 25.0
"""For this long the robot does not choose a cloud whose pods are going: they are killed 20 s after the request to end.

After that their successors are not ready until their nodes are. A new agent ends this time, because it is another
one."""
VERSION = 1
MAX_TOPICS = 64
"""Most topics in the state file: those that carried the most."""


class Carried(NamedTuple):
    """What crossed the link of one topic since the agent's start; `direction` is to_cloud or to_robot.

    `age_ms` is the age of the newest message on arrival here; None: not known.
    """

    topic: str
    direction: str
    bytes: int
    messages: int
    age_ms: int | None = None


@dataclass(frozen=True)
class Liaison:
    """State. Times on the steady clock, seconds; `since` is a text of the system clock.

    Attributes:
        watched: there is a settings file.
        offer: its settings; None while it cannot be read, then `problem` states why.
        robot: the newest notes of the robot; None before the first of this connection.
        generation: that the robot ran when it was last heard; None never.
        connected: a robot is heard; since when it is (not).
        signs: the operator signs certificates for robots, and writes its answers to a file.
        answer: its newest answer; "" for none.
        leaving, leaving_until_s: the end of pods requested last; "" for none.
        handed_over: the end of pods for which the robot acts, or for which there was no robot to act.
    """

    watched: bool = False
    offer: Offer | None = None
    problem: str = ""
    robot: RobotNotes | None = None
    generation: int | None = None
    connected: bool = False
    since: str = ""
    signs: bool = False
    answer: str = ""
    leaving: str = ""
    leaving_until_s: float = 0.0
    handed_over: str = ""


@dataclass(frozen=True)
class SettingsRead:
    """The settings file has new content, or cannot be read (`problem`)."""

    offer: Offer | None
    problem: str = ""


@dataclass(frozen=True)
class AnswerRead:
    """The file with the answer to the robot's request for a certificate has new content."""

    answer: str


@dataclass(frozen=True)
class HandoverAsked:
    """The handover file has new content."""

    name: str


@dataclass(frozen=True)
class RobotSaid:
    """Notes of the robot arrived."""

    notes: RobotNotes


@dataclass(frozen=True)
class Seen:
    """A robot is heard, or not; `wall` is the system clock as a text."""

    connected: bool
    wall: str


Event = SettingsRead | AnswerRead | HandoverAsked | RobotSaid | Seen


def step(liaison: Liaison, event: Event, now_s: float) -> Liaison:
    """Process one event."""
    match event:
        case SettingsRead():
            liaison = replace(liaison, offer=event.offer, problem=event.problem)
        case AnswerRead():
            liaison = replace(liaison, answer=event.answer)
        case HandoverAsked():
            if event.name and event.name != liaison.leaving:
                liaison = replace(liaison, leaving=event.name, leaving_until_s=now_s + LEAVING_S)
        case RobotSaid():
            liaison = replace(liaison, robot=event.notes, generation=event.notes.generation)
        case Seen():
            if event.connected is not liaison.connected or not liaison.since:
                liaison = replace(liaison, connected=event.connected, since=event.wall, robot=None)
        case _:
            assert_never(event)
    return replace(liaison, handed_over=liaison.leaving) if _left(liaison) else liaison


def notes(liaison: Liaison, now_s: float) -> CloudNotes:
    """Return the notes for the robot; offer settings that it could not store again and again."""
    robot = liaison.robot
    answered = robot is not None and _answered(robot, liaison.offer) and robot.reason != Answer.NOT_KEPT
    leaving = liaison.leaving if now_s < liaison.leaving_until_s else ""
    asks = robot is not None and bool(robot.credential.request)
    return CloudNotes(None if answered else liaison.offer, leaving, liaison.signs, liaison.answer if asks else "")


def taken(liaison: Liaison) -> Offer | None:
    """Return the settings offered, once the robot has taken them."""
    robot = liaison.robot
    return liaison.offer if robot is not None and robot.accepted and _answered(robot, liaison.offer) else None


def state(
    liaison: Liaison,
    *,
    generation: int,
    epoch: int,
    nodes: Iterable[tuple[str, str]],
    ready: bool,
) -> dict[str, Any]:
    """Return the content of the state file, without the time of writing and the figures."""
    site, reason, message = _placement(liaison)
    return {
        "version": VERSION,
        "agent_generation": generation,
        "connected": liaison.connected,
        "since": liaison.since,
        "site": site,
        "epoch": epoch,
        "reason": reason,
        "message": message,
        "nodes": [{"name": name, "state": word} for name, word in nodes],
        "settings": _settings(liaison),
        "certificate": vars(liaison.robot.credential if liaison.robot is not None else Credential()),
        "dials": liaison.robot.dials if liaison.robot is not None else "",
        "audit": liaison.robot.audit if liaison.robot is not None else "",
        "handover": liaison.handed_over,
        "ready": ready,
    }


def figures(
    health: Health | None, glance: Glance, carried: Iterable[Carried], ages_ms: Mapping[str, int]
) -> dict[str, Any]:
    """Return the part of the state file that differs each time.

    Args:
        health: of the link; None: not known.
        glance: the link's present state.
        carried: what crossed the link so far.
        ages_ms: how old the state was when the cloud last took over with it, by name of the entry.
    """
    p50, p99 = (health.round_trip_p50_ms, health.round_trip_p99_ms) if health else (None, None)
    most = sorted(carried, key=lambda topic: -topic.bytes)[:MAX_TOPICS]
    shown = [topic._asdict() for topic in sorted(most)]
    ages = [{"name": name, "age_ms": age_ms} for name, age_ms in sorted(ages_ms.items())[:MAX_TOPICS]]
    link = {
        "latency_ms": glance.latency_ms,
        "loss_share": glance.loss_share,
        "age_ms": health.age_ms if health else None,
        "up_ms": health.up_ms if health else None,
        "down_ms": health.down_ms if health else None,
    }
    return {"round_trip_ms": {"p50": p50, "p99": p99}, "link": link, "carried": shown, "state_ages": ages}


def _left(liaison: Liaison) -> bool:
    """Return whether no robot has to be asked: the robot acts and will not choose this cloud, or there is none."""
    if not liaison.leaving or liaison.handed_over == liaison.leaving:
        return False
    robot = liaison.robot
    return not liaison.connected or (robot is not None and robot.left == liaison.leaving and robot.site == "robot")


def _answered(robot: RobotNotes, offer: Offer | None) -> bool:
    return offer is None or robot.digest == offer.digest


def _placement(liaison: Liaison) -> tuple[str, str, str]:
    robot = liaison.robot
    if not liaison.connected:
        return "unknown", "RobotNotConnected", "No robot is heard; start its agent, then look at the link"
    if robot is None:
        return "unknown", "Connecting", "The robot is heard and has not told yet who acts"
    return robot.site, robot.decided, robot.decided_message


def _settings(liaison: Liaison) -> dict[str, Any]:
    robot, offer = liaison.robot, liaison.offer
    accepted: bool | None = None
    if not liaison.watched:
        reason, message = "NotOffered", "This agent has no settings file; the robot runs its own file"
    elif offer is None:
        reason, message = "SettingsUnreadable", liaison.problem or "The settings file has not been read yet"
    elif robot is None:
        reason, message = "RobotNotConnected", f"Generation {offer.generation} waits for the robot"
    elif not _answered(robot, offer):
        reason, message = "Pending", f"The robot has not answered to generation {offer.generation} yet"
    else:
        accepted, reason, message = robot.accepted, robot.reason, robot.message
    return {"robot_generation": liaison.generation, "accepted": accepted, "reason": reason, "message": message}
