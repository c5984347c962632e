"""The cloud agent's state file, read without trust: what is there, what it means, how old it is.

The agent replaces the file on every transition and at least five times a second. The same text travels in the
annotation of the robot's Lease (without the live numbers) and through the reporter's `/state` and `/stream`, so this is
its only reader.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.printable import printable
from robot_offload.api.side_numbers import SideNumbers, parse_numbers
from robot_offload.errors import RobotOffloadError

VERSION: Final = 1
FRESH_S: Final = 5.0
"""How long a state counts: the agent writes five times a second, so 25 missing ones mean that it has stopped."""
ANNOTATION: Final = "robotoffload.dev/state"
"""On the robot's Lease: the state as compact JSON."""
MAX_TEXT: Final = 32_768
"""Characters of a whole state. A state of 64 nodes and 64 topics has about 10,000."""
MAX_SENTENCE: Final = 1024
MAX_NODES: Final = 64
"""As many as a specification may have."""
MAX_TOPICS: Final = 64
"""Those that carried the most."""
DIRECTIONS: Final = ("to_cloud", "to_robot")
UNREADABLE: Final = "Unreadable"
"""Stands in place of a reason that is not a single word."""
_REASON: Final = re.compile(r"[A-Za-z]{1,64}")
_SERIAL: Final = re.compile(r"[0-9a-f]{0,40}")
_TIME: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_DIALLED: Final = re.compile(r"[0-9A-Za-z.:\[\]-]{3,262}")
MAX_DIALLED: Final = 16
"""Addresses of one bundle that are kept: those of a few nodes of the cluster, two ports each."""
_HEAD: Final = re.compile(r"[1-9][0-9]{0,14}:[0-9a-f]{64}")
_INT64: Final = range(-(2**63), 2**63)
_LIVE_FIELDS: Final = ("written", "round_trip_ms", "link", "carried", "state_ages", "cloud", "robot")
"""What changes all the time; it is in the metrics and never in the Lease."""


class StateError(RobotOffloadError):
    """The text is no state of an agent."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What became of the run-time settings on the robot.

    Attributes:
        robot_generation: the generation that the robot runs; None: it has not said.
        accepted: whether it took the last ones; None: it has not answered.
        reason: one CamelCase word.
        message: one sentence.
    """

    robot_generation: int | None = None
    accepted: bool | None = None
    reason: str = ""
    message: str = ""


@dataclass(frozen=True, slots=True)
class RobotCertificate:
    """The certificate with which the robot dials, as the robot says.

    Attributes:
        serial: its serial number, hexadecimal; empty: the robot has not said.
        not_after: RFC 3339 time of its end.
        request: what the robot asks to be signed for its next key, as it came; empty: nothing.
        reason: why it cannot get another one, one CamelCase word; empty: it can, or need not yet.
        message: the same as a sentence.
    """

    serial: str = ""
    not_after: str = ""
    request: str = ""
    reason: str = ""
    message: str = ""


@dataclass(frozen=True, slots=True)
class Carried:
    """What crossed the link of one topic; `direction` is one of DIRECTIONS, empty from an older agent.

    `age_ms` is that of the newest message when it came to the cloud; None: not known.
    """

    topic: str
    direction: str
    bytes: int
    messages: int
    age_ms: int | None = None


@dataclass(frozen=True, slots=True)
class AgentState:
    """What the cloud agent says about its robot and itself.

    Attributes:
        agent_generation: the generation of the RobotOffload that the cloud agent was started with.
        connected: whether the robot's agent is there.
        since: RFC 3339 time of the last change of `connected`.
        site: who acts: robot, cloud or unknown.
        epoch: the number of the changeover.
        reason: why this side acts, one CamelCase word.
        message: the same as a sentence.
        round_trip_p50_ms: the median round trip of the heartbeats; None: not known.
        round_trip_p99_ms: the round trip that one of a hundred exceeds; None: not known.
        carried: what crossed the link since the agent's start.
        state_ages_ms: how old the state was with which the cloud went on at its last change, by name of the entry.
        nodes: name and lifecycle state of each node in the cloud.
        settings: what became of the run-time settings on the robot.
        certificate: with which the robot dials.
        dials: addresses (host:port) of the cloud that the robot's bundle names; none: it has not said, or another
            program dials.
        audit: the newest entry of the robot's audit trail, NUMBER:DIGEST; empty: it has not said.
        ready: whether the agent listens for its robot; no robot need be there.
        handover: the id of the last handover that the agent has finished.
        written: RFC 3339 time at which the agent wrote this.
        cloud, robot: the numbers of the two sides' agents; None: it has said none, or nothing for 5 s.
    """

    agent_generation: int = 0
    connected: bool = False
    since: str = ""
    site: str = "unknown"
    epoch: int = 0
    reason: str = ""
    message: str = ""
    round_trip_p50_ms: float | None = None
    round_trip_p99_ms: float | None = None
    carried: tuple[Carried, ...] = ()
    state_ages_ms: tuple[tuple[str, int], ...] = ()
    nodes: tuple[tuple[str, str], ...] = ()
    settings: Settings = Settings()
    certificate: RobotCertificate = RobotCertificate()
    dials: tuple[str, ...] = ()
    audit: str = ""
    ready: bool = False
    handover: str = ""
    written: str = ""
    cloud: SideNumbers | None = None
    robot: SideNumbers | None = None


def parse_state(text: str) -> AgentState:
    """Read a state; unknown fields are left alone, because a newer agent may say more.

    What the robot's side wrote is bounded here, at its first reader: reasons are single words, sentences are cut, and
    no text has control characters.

    Raises:
        StateError: it is no JSON object of a version that we know, is too long, or a field has the wrong type or size.
    """
    values = _object(text)
    if values.get("version") != VERSION:
        raise StateError(
            f"the agent's state has version {_shown(values.get('version'))}, this reporter reads {VERSION}"
        )
    round_trip = _part(values, "round_trip_ms")
    settings = _part(values, "settings")
    return AgentState(
        agent_generation=_of(values, "agent_generation", int, 0),
        connected=_of(values, "connected", bool, False),
        since=_line(values, "since", ""),
        site=_line(values, "site", "unknown"),
        epoch=_of(values, "epoch", int, 0),
        reason=_reason(values),
        message=_sentence(values),
        round_trip_p50_ms=_number(round_trip, "p50"),
        round_trip_p99_ms=_number(round_trip, "p99"),
        carried=_carried(values),
        state_ages_ms=_counts(values, "state_ages", "name", "age_ms"),
        nodes=_nodes(values),
        settings=Settings(
            robot_generation=_of(settings, "robot_generation", int, None),
            accepted=_of(settings, "accepted", bool, None),
            reason=_reason(settings),
            message=_sentence(settings),
        ),
        certificate=_certificate(_part(values, "certificate")),
        dials=_addresses(values),
        audit=_head(values),
        ready=_of(values, "ready", bool, False),
        handover=_line(values, "handover", ""),
        written=_line(values, "written", ""),
        cloud=parse_numbers(values.get("cloud")),
        robot=parse_numbers(values.get("robot")),
    )


def lasting(text: str) -> str:
    """Return the state without its live numbers, as compact JSON: equal texts mean that nothing has happened.

    Raises:
        StateError: `text` is no JSON object.
    """
    values = {name: value for name, value in _object(text).items() if name not in _LIVE_FIELDS}
    return json.dumps(values, separators=(",", ":"), sort_keys=True)


def _object(text: str) -> dict[str, Any]:
    if len(text) > MAX_TEXT:
        raise StateError(f"the agent's state has {len(text)} characters, more than {MAX_TEXT}")
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StateError(f"the agent's state is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise StateError("the agent's state is not a JSON object")
    return values


def _part(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = values.get(name) or {}
    if not isinstance(part, Mapping):
        raise StateError(f"{name} of the agent's state is not a mapping")
    return part


def _of(values: Mapping[str, Any], name: str, kind: type, default: object) -> Any:
    value = values.get(name)
    if value is None:
        return default
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise StateError(f"{name} of the agent's state is {_shown(value)}, not {kind.__name__}")
    if kind is int and value not in _INT64:
        raise StateError(f"{name} of the agent's state is too large")
    return value


def _line(values: Mapping[str, Any], name: str, default: str) -> str:
    return printable(_of(values, name, str, default))


def _reason(values: Mapping[str, Any]) -> str:
    reason: str = _of(values, "reason", str, "")
    return reason if not reason or _REASON.fullmatch(reason) else UNREADABLE


def _sentence(values: Mapping[str, Any]) -> str:
    message = _line(values, "message", "")
    return message if len(message) <= MAX_SENTENCE else f"{message[: MAX_SENTENCE - 3]}..."


def _certificate(values: Mapping[str, Any]) -> RobotCertificate:
    serial: str = _of(values, "serial", str, "")
    not_after: str = _of(values, "not_after", str, "")
    if not _SERIAL.fullmatch(serial) or (not_after and not _TIME.fullmatch(not_after)):
        raise StateError("certificate of the agent's state names no serial number and time")
    return RobotCertificate(serial, not_after, _of(values, "request", str, ""), _reason(values), _sentence(values))


def _addresses(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the addresses that a robot dials; what has another form is no address."""
    words = _of(values, "dials", str, "").split()
    return tuple(dict.fromkeys(word for word in words if _DIALLED.fullmatch(word)))[:MAX_DIALLED]


def _head(values: Mapping[str, Any]) -> str:
    """Return the newest entry of the audit trail; what has another form is none."""
    head: str = _of(values, "audit", str, "")
    return head if _HEAD.fullmatch(head) else ""


def _shown(value: object) -> str:
    """Return a value as an error message shows it."""
    text = ascii(value)
    return text if len(text) <= 64 else f"{text[:61]}..."


def _number(values: Mapping[str, Any], name: str) -> float | None:
    value = values.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise StateError(f"{name} of the agent's state is {_shown(value)}, not a number")
    try:
        number = float(value)
    except OverflowError as error:
        raise StateError(f"{name} of the agent's state is too large") from error
    return number if math.isfinite(number) else None


def _nodes(values: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    nodes = values.get("nodes") or []
    if not isinstance(nodes, list) or not all(isinstance(node, Mapping) for node in nodes):
        raise StateError("nodes of the agent's state is not a list of mappings")
    if len(nodes) > MAX_NODES:
        raise StateError(f"the agent's state names {len(nodes)} nodes; {MAX_NODES} at most can be declared")
    return tuple((_word(node, "name"), _word(node, "state")) for node in nodes)


def _counts(values: Mapping[str, Any], field: str, name: str, count: str) -> tuple[tuple[str, int], ...]:
    listed = values.get(field) or []
    if not isinstance(listed, list) or not all(isinstance(entry, Mapping) for entry in listed):
        raise StateError(f"{field} of the agent's state is not a list of mappings")
    return tuple((_word(entry, name), _of(entry, count, int, 0)) for entry in listed[:MAX_TOPICS])


def _carried(values: Mapping[str, Any]) -> tuple[Carried, ...]:
    listed = values.get("carried") or []
    amounts = _counts(values, "carried", "topic", "bytes")
    ways = (_word(entry, "direction") for entry in listed)
    return tuple(
        Carried(
            topic,
            way if way in DIRECTIONS else "",
            amount,
            _of(entry, "messages", int, 0),
            _of(entry, "age_ms", int, None),
        )
        for (topic, amount), way, entry in zip(amounts, ways, listed, strict=False)
    )


def _word(values: Mapping[str, Any], name: str) -> str:
    return printable(str(values.get(name, ""))[:253])


# -- how old it is ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Sight:
    """The state file as it was last seen to change.

    Attributes:
        text: its content; empty: never read.
        state: what it says; None: nothing usable was ever read.
        changed_s: when its content last changed, on the reporter's own steady clock.
        problem: why the present content cannot be used; empty: it can.
    """

    text: str = ""
    state: AgentState | None = None
    changed_s: float = float("-inf")
    problem: str = "the agent has not written its state yet"

    def fresh(self, now_s: float) -> bool:
        """Return whether the agent lives: its last usable state is young enough."""
        return self.state is not None and now_s - self.changed_s <= FRESH_S

    def age_s(self, now_s: float) -> float:
        """Return the age of the last usable state in seconds; endless before the first one."""
        return now_s - self.changed_s


def silence(sight: Sight, now_s: float) -> str:
    """Return why nobody can vouch for the agent's state; empty: it is young enough."""
    if sight.state is None:
        return sight.problem
    if sight.fresh(now_s):
        return ""
    silent = f"the cloud agent has written nothing new for {sight.age_s(now_s):.0f} s"
    return f"{silent}: {sight.problem}" if sight.problem else silent


def look(before: Sight, text: str | None, now_s: float, *, written_ago_s: float = 0.0) -> Sight:
    """Return the sight after reading the file.

    Only a change of the content counts as a sign of life: a host's clock may step, the steady clock does not.

    Args:
        before: the last sight.
        text: the file's content; None: there is no file.
        now_s: the steady clock.
        written_ago_s: how long ago the file was written, for the first look only: a file left by a dead agent is old.
    """
    if text is None:
        return Sight(before.text, before.state, before.changed_s, "there is no state file: the agent has not started")
    if text == before.text and not before.problem:
        return before
    try:
        state = parse_state(text)
    except StateError as error:
        return Sight(before.text, before.state, before.changed_s, str(error))
    if text == before.text:
        return Sight(text, state, before.changed_s, "")
    first = before.state is None
    return Sight(text, state, now_s - max(0.0, written_ago_s) if first else now_s, "")
