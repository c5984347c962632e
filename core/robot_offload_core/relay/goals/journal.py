"""The journal of the robot's relay: what its successor needs, as records that are read strictly and in order.

A record is whole or does not count: length 4, CRC-32 4, body. A torn end is dropped with everything behind it. Nothing
is pickled, and nothing is code: a body is JSON with its bytes in hexadecimal. Only the payloads of goals and results
follow the JSON unchanged.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.near import NearGoal
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.goals.state import Attempt, AttemptPhase, Goal, Ledger, Why
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.replace import replace

FRAME = struct.Struct(">II")
BODY = struct.Struct(">I")
MAX_RECORD = 4 * 1024 * 1024


class JournalError(ValueError):
    """A record that is not valid."""


@dataclass(frozen=True)
class UsedKept:
    """A goal at an action outside the group, see `used_goals.UsedGoal`. `stay`: None while it waited."""

    id: bytes
    action: str
    site: Site
    token: Token | None
    stay: int | None
    relay: str
    payload: bytes


@dataclass
class Replayed:
    """The content of a journal.

    Attributes:
        goals: in the client's order.
        holding: the newest stay that was taken into account.
        calls: open service calls, caller -> service.
        dropped: number of invalid records.
        used: goals at actions outside.
        near: goals of the robot's own nodes there, as their clients see them.
    """

    goals: dict[bytes, Goal] = field(default_factory=dict)
    holding: Holding | None = None
    calls: dict[bytes, str] = field(default_factory=dict)
    dropped: int = 0
    used: dict[bytes, UsedKept] = field(default_factory=dict)
    near: dict[bytes, NearGoal] = field(default_factory=dict)


# -- frames -----------------------------------------------------------------------------------------------------------


def frame(record: bytes) -> bytes:
    """Return a record as it is stored in the file."""
    return FRAME.pack(len(record), zlib.crc32(record)) + record


def unframe(data: bytes) -> Iterator[bytes]:
    """Return the whole records at the beginning of a file's bytes; stop at a torn one."""
    at = 0
    while at + FRAME.size <= len(data):
        size, check = FRAME.unpack_from(data, at)
        record = bytes(data[at + FRAME.size : at + FRAME.size + size])
        if not 0 < size <= MAX_RECORD or len(record) < size or zlib.crc32(record) != check:
            return
        yield record
        at += FRAME.size + size


# -- records ----------------------------------------------------------------------------------------------------------


def changes(before: Ledger, after: Ledger) -> list[bytes]:
    """Return the records of a step that a successor needs."""
    records = []
    if after.holding != before.holding:
        records.append(_record({"k": "stay", **_holding(after.holding)}))
    if after.goals is before.goals:
        return records
    for goal_id, goal in after.goals.items():
        was = before.goals.get(goal_id)
        if was is None:
            records.append(_record({"k": "goal", **_goal(goal)}, goal.payload))
        elif was is not goal and _goal(was) != _goal(goal):
            result = goal.result if was.ended_s is None else b""
            records.append(_record({"k": "state", **_goal(goal)}, result))
    records += [_record({"k": "drop", "id": gone.hex()}) for gone in before.goals if gone not in after.goals]
    return records


def whole(ledger: Ledger, calls: dict[bytes, str]) -> list[bytes]:
    """Return the fewest records that are equivalent to all so far."""
    records = [_record({"k": "stay", **_holding(ledger.holding)})]
    for goal in ledger.goals.values():
        records.append(_record({"k": "goal", **_goal(goal)}, goal.payload))
        if goal.ended_s is not None:
            records.append(_record({"k": "state", **_goal(goal)}, goal.result))
    return records + [call_opened(caller, service) for caller, service in calls.items()]


def call_opened(caller: bytes, service: str) -> bytes:
    """Return the record of a service call that waits for its answer."""
    return _record({"k": "call", "c": caller.hex(), "s": service})


def call_closed(caller: bytes) -> bytes:
    """Return the record that a service call was answered."""
    return _record({"k": "done", "c": caller.hex()})


def used_kept(goal: UsedKept) -> bytes:
    """Return the record of a goal at an action outside the group."""
    words = {
        "k": "used", "id": goal.id.hex(), "a": goal.action, "at": goal.site.value,
        "token": None if goal.token is None else _token_words(goal.token), "stay": goal.stay, "relay": goal.relay,
    }  # fmt: skip
    return _record(words, goal.payload)


def used_ended(goal_id: bytes) -> bytes:
    """Return the record that such a goal has ended."""
    return _record({"k": "unused", "id": goal_id.hex()})


def near_kept(goal: NearGoal) -> bytes:
    """Return the record of what a client of the robot's group knows of its goal outside."""
    words = {
        "k": "near", "id": goal.id.hex(), "a": goal.action, "t": goal.stamp_ns, "s": int(goal.status),
        "x": goal.cancel, "e": goal.ended_s, "r": [caller.hex() for caller in goal.waiting],
    }  # fmt: skip
    return _record(words, goal.result)


def near_forgotten(goal_id: bytes) -> bytes:
    """Return the record that no client asks for a goal's result any more."""
    return _record({"k": "far", "id": goal_id.hex()})


def replay(records: Iterable[bytes]) -> Replayed:
    """Read records in order; leave out invalid ones."""
    said = Replayed()
    for record in records:
        try:
            _take(said, record)
        except (JournalError, KeyError, ValueError, TypeError):
            said.dropped += 1
    return said


def restored(ledger: Ledger, said: Replayed) -> Ledger:
    """Return a new ledger with the goals of its predecessor."""
    goals = {goal_id: goal for goal_id, goal in said.goals.items() if goal.action in ledger.actions}
    index = {a.id: goal.id for goal in goals.values() for a in goal.attempts}
    counter = max(
        (n for goal in goals.values() for n in (goal.order, *(a.rank for a in goal.attempts))), default=0
    )  # fmt: skip
    holding = said.holding or ledger.holding
    return replace(ledger, goals=goals, index=index, counter=max(counter, ledger.counter), holding=holding)


# -- bodies -----------------------------------------------------------------------------------------------------------


def _record(words: dict[str, Any], payload: bytes = b"") -> bytes:
    text = json.dumps(words, separators=(",", ":")).encode()
    return BODY.pack(len(text)) + text + payload


def _open(record: bytes) -> tuple[dict[str, Any], bytes]:
    if len(record) < BODY.size:
        raise JournalError("too short")
    (size,) = BODY.unpack_from(record)
    words = json.loads(record[BODY.size : BODY.size + size])
    if not isinstance(words, dict):
        raise JournalError("no table")
    return words, record[BODY.size + size :]


def _take(said: Replayed, record: bytes) -> None:
    words, payload = _open(record)
    kind = words["k"]
    if kind == "stay":
        said.holding = Holding(Site(words["at"]), int(words["stay"]), _token(words["token"]))
    elif kind == "goal":
        goal = _goal_of(words)
        said.goals[goal.id] = replace(goal, payload=payload)
    elif kind == "state":
        known = said.goals[bytes.fromhex(words["id"])]
        goal = _goal_of(words)
        said.goals[goal.id] = replace(goal, payload=known.payload, result=payload or known.result)
    elif kind == "drop":
        said.goals.pop(bytes.fromhex(words["id"]), None)
    elif kind == "call":
        said.calls[bytes.fromhex(words["c"])] = str(words["s"])
    elif kind == "done":
        said.calls.pop(bytes.fromhex(words["c"]), None)
    else:
        _take_used(said, words, payload)


def _take_used(said: Replayed, words: dict[str, Any], payload: bytes) -> None:
    kind, goal_id = words["k"], bytes.fromhex(words["id"])
    if kind == "used":
        token = None if words["token"] is None else _token(words["token"])
        stay = None if words["stay"] is None else int(words["stay"])
        said.used[goal_id] = UsedKept(
            goal_id, str(words["a"]), Site(words["at"]), token, stay, str(words["relay"]), payload
        )
    elif kind == "unused":
        said.used.pop(goal_id, None)
    elif kind == "near":
        said.near[goal_id] = NearGoal(
            goal_id, str(words["a"]), int(words["t"]), GoalStatus(words["s"]), bool(words["x"]),
            [bytes.fromhex(caller) for caller in words["r"]], payload,
            None if words["e"] is None else float(words["e"]),
        )  # fmt: skip
    elif kind == "far":
        said.near.pop(goal_id, None)
    else:
        raise JournalError(f"{kind!r} is no kind of record")


def _holding(holding: Holding) -> dict[str, Any]:
    return {"at": holding.site.value, "stay": holding.stay, "token": _token_words(holding.token)}


def _token_words(token: Token) -> list[Any]:
    return [token.robot, token.epoch, token.cloud]


def _token(words: Any) -> Token:
    robot, epoch, cloud = words
    return Token(str(robot), int(epoch), str(cloud))


def _goal(goal: Goal) -> dict[str, Any]:
    return {
        "id": goal.id.hex(), "a": goal.action, "o": goal.order, "t": goal.stamp_ns, "c": goal.caller.hex(),
        "s": int(goal.status), "w": goal.why.value if goal.why else "", "e": goal.ended_s, "x": goal.cancel,
        "r": [caller.hex() for caller in goal.waiting], "n": [goal.need_s, goal.able_s, goal.moved, goal.moves],
        "l": [_attempt(attempt) for attempt in goal.attempts],
    }  # fmt: skip


def _goal_of(words: dict[str, Any]) -> Goal:
    need_s, able_s, moved, *moves = words["n"]  # without the last: written by an earlier version
    return Goal(
        bytes.fromhex(words["id"]), str(words["a"]), b"", int(words["o"]), int(words["t"]),
        caller=bytes.fromhex(words["c"]), status=GoalStatus(words["s"]),
        why=Why(words["w"]) if words["w"] else None, ended_s=None if words["e"] is None else float(words["e"]),
        cancel=bool(words["x"]), waiting=tuple(bytes.fromhex(caller) for caller in words["r"]),
        attempts=tuple(_attempt_of(attempt) for attempt in words["l"]),
        need_s=float(need_s), able_s=None if able_s is None else float(able_s), moved=bool(moved),
        moves=int(moves[0]) if moves else 0,
    )  # fmt: skip


def _attempt(attempt: Attempt) -> list[Any]:
    return [
        attempt.id.hex(), attempt.site.value, _token_words(attempt.token), attempt.offered_s, attempt.phase.value,
        attempt.rank, int(attempt.status), attempt.ended_s, attempt.cancel,
    ]  # fmt: skip


def _attempt_of(words: Any) -> Attempt:
    attempt, site, token, offered_s, phase, rank, status, ended_s, cancel = words
    return Attempt(
        bytes.fromhex(attempt), Site(site), _token(token), float(offered_s), AttemptPhase(phase), int(rank),
        GoalStatus(status), float(ended_s), bool(cancel),
    )  # fmt: skip
