"""The black box: all input of a control process, in a form from which the same core reaches the same decisions.

The machines of a control process are pure functions of (state, event, now). A box keeps, as lines of text, an
occasional state (key frame), every event with its time, and every decision. `replay` runs the core over the lines.

Format 1: each line is a CRC-32 (eight hexadecimal digits), a blank, and a JSON list:
    ["box", format, {"side", "release", "core", ...}]    the first line of each file
    ["state", machine, now_s, state]                      a key frame
    ["set", machine, now_s, state]                        a state not from a step: the first, or changed settings
    ["step", machine, now_s, event's name, event]         an event
    ["did", machine, now_s, name, decision]               a decision of the step before
    ["broke", machine, now_s, event's name, event, rule]  a step that broke a rule of the machine; the process ended
    ["gap", steps]                                        number of steps that were not written
Records are lists of their fields, in order (`codec.plain`). A line with a wrong checksum is skipped: a file may end in
the middle of one. After a gap, and when another process begins, a machine continues from its next key frame.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final, get_args

from robot_offload_core.control.cloud import lease
from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.control.robot import placement, switcher
from robot_offload_core.words import codec
from robot_offload_core.words.checks import InvariantError, rule_of
from robot_offload_core.words.decided import Decided
from robot_offload_core.words.events import Machine
from robot_offload_core.words.replace import replace

FORMAT: Final = 1
SUM_LENGTH: Final = 8


@dataclass(frozen=True)
class MachineKind:
    """How to step and read one machine: its step, the type of its state, its events and decisions by name."""

    step: Callable[[Any, Any, float], tuple[Any, Any]]
    state: type
    events: dict[str, type]
    decisions: dict[str, type]


def _named(union: Any) -> dict[str, type]:
    return {kind.__name__: kind for kind in get_args(union)}


KINDS: Final = {
    Machine.PLACEMENT: MachineKind(switcher.step, placement.Robot, _named(placement.Event), {"Decided": Decided}),
    Machine.LEASE: MachineKind(lease.step, lease.Cloud, _named(lease.Event), {"StandChanged": lease.StandChanged}),
    Machine.GUARDIAN: MachineKind(
        guardians.step,
        guardians.Guardian,
        _named(guardians.Event),
        {kind.__name__: kind for kind in (managed_nodes.ChangeState, managed_nodes.Inhibit, managed_nodes.NodeNews)},
    ),
}
"""The machines of the control processes. Commands other than `decisions` follow from the state and are not written."""


def digest(sources: Iterable[tuple[str, bytes]]) -> str:
    """Return a digest of the core's files (name, content); code with another digest may decide differently."""
    found = hashlib.sha256()
    for name, content in sorted(sources):
        found.update(name.encode() + b"\0" + content)
    return found.hexdigest()[:16]


# -- writing ----------------------------------------------------------------------------------------------------------


def line(record: list[Any]) -> str:
    """Return a record as a line, with its checksum."""
    text = json.dumps(record, separators=(",", ":"), ensure_ascii=True)
    return f"{zlib.crc32(text.encode()):08x} {text}\n"


def header(facts: dict[str, Any]) -> str:
    """Return the first line of a file; in `facts`, `process` names the writer and `core` the code."""
    return line(["box", FORMAT, facts])


def key_frame(machine: Machine, now_s: float, state: Any, *, was_set: bool = False) -> str:
    """Return the line of a state; `was_set`: it is not the result of a step."""
    return line(["set" if was_set else "state", machine.value, now_s, codec.plain(comparable(state))])


def step(machine: Machine, now_s: float, event: Any, commands: Iterable[Any]) -> str:
    """Return the lines of a step: its event and its decisions."""
    lines = [line(["step", machine.value, now_s, type(event).__name__, codec.plain(event)])]
    for decision in decisions(machine, commands):
        lines.append(line(["did", machine.value, now_s, type(decision).__name__, codec.plain(decision)]))
    return "".join(lines)


def broken_step(machine: Machine, now_s: float, event: Any, rule: str) -> str:
    """Return the line of a step that broke a rule of its machine."""
    return line(["broke", machine.value, now_s, type(event).__name__, codec.plain(event), rule])


def gap(steps: int) -> str:
    """Return the line that records how many steps are missing."""
    return line(["gap", steps])


def decisions(machine: Machine, commands: Iterable[Any]) -> list[Any]:
    """Return the commands of a machine that a box keeps."""
    kinds = tuple(KINDS[machine].decisions.values())
    return [command for command in commands if isinstance(command, kinds)]


def comparable(state: Any) -> Any:
    """Return a state without the levels sent last: they are sent again and decide nothing."""
    return replace(state, levels=(), levels_s=-1.0) if isinstance(state, placement.Robot) else state


# -- reading ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Header:
    """The first line of a file."""

    format: int
    facts: dict[str, Any]


@dataclass(frozen=True)
class KeyFrame:
    """A recorded state; `was_set`: it is not the result of a step."""

    machine: Machine
    now_s: float
    state: Any
    was_set: bool = False


@dataclass(frozen=True)
class Step:
    """A recorded event of a machine."""

    machine: Machine
    now_s: float
    event: Any


@dataclass(frozen=True)
class Did:
    """A recorded decision."""

    machine: Machine
    now_s: float
    decision: Any


@dataclass(frozen=True)
class Broke:
    """An event whose step broke a rule of the machine and led to no state."""

    machine: Machine
    now_s: float
    event: Any
    rule: str


@dataclass(frozen=True)
class Gap:
    """Number of missing steps; 0: unknown, or a line that cannot be read."""

    steps: int


Record = Header | KeyFrame | Step | Did | Broke | Gap


def parse(text: str) -> Record:
    """Parse a line; return a Gap if it is torn, altered, or of a type unknown to this release."""
    words = text.rstrip("\n")
    try:
        if int(words[:SUM_LENGTH], 16) != zlib.crc32(words[SUM_LENGTH + 1 :].encode()):
            return Gap(0)
        return _record(json.loads(words[SUM_LENGTH + 1 :]))
    except (ValueError, KeyError, TypeError, IndexError, RecursionError):
        return Gap(0)


def _record(parts: list[Any]) -> Record:
    word = parts[0]
    if word == "box":
        return Header(codec.typed(int, parts[1]), dict(parts[2]))
    if word == "gap":
        return Gap(codec.typed(int, parts[1]))
    machine, now_s = Machine(parts[1]), codec.typed(float, parts[2])
    kind = KINDS[machine]
    if word in ("state", "set"):
        return KeyFrame(machine, now_s, codec.typed(kind.state, parts[3]), word == "set")
    if word == "step":
        return Step(machine, now_s, codec.typed(kind.events[parts[3]], parts[4]))
    if word == "broke":
        event = codec.typed(kind.events[parts[3]], parts[4])
        return Broke(machine, now_s, event, codec.typed(str, parts[5]))
    if word == "did":
        return Did(machine, now_s, codec.typed(kind.decisions[parts[3]], parts[4]))
    raise ValueError(word)


@dataclass(frozen=True)
class Replayed:
    """A step that was run again.

    Attributes:
        machine, now_s, event: as written.
        before, after: states.
        decided: decisions of the present core.
    """

    machine: Machine
    now_s: float
    event: Any
    before: Any
    after: Any
    decided: tuple[Any, ...]


@dataclass(frozen=True)
class RuleBroken:
    """A step that breaks a rule of its machine when it is run again.

    Attributes:
        machine, now_s, event: as written.
        before: the state before the step.
        rule: the broken rule, in words.
    """

    machine: Machine
    now_s: float
    event: Any
    before: Any
    rule: str


@dataclass(frozen=True)
class Differs:
    """The present core does not do what was written.

    Attributes:
        machine, now_s: of the step.
        written, replayed: decisions, states at a key frame, or the rule that was broken.
    """

    machine: Machine
    now_s: float
    written: tuple[Any, ...]
    replayed: tuple[Any, ...]


Found = Header | Gap | Replayed | RuleBroken | Differs


def replay(lines: Iterable[str]) -> Iterator[Found]:
    """Run the core over the lines of a box.

    A machine is replayed from its first key frame; later ones are compared with the replayed state. Headers and gaps
    are passed through. A machine that breaks a rule continues from its next key frame.
    """
    players: dict[Machine, _Player] = {machine: _Player(machine) for machine in KINDS}
    process: object = None
    for text in lines:
        record = parse(text)
        if isinstance(record, Gap | Header):
            goes_on = isinstance(record, Header) and record.facts.get("process") == process
            process = record.facts.get("process") if isinstance(record, Header) else process
            for player in players.values():
                yield from player.settle()
                player.state = player.state if goes_on else None
            yield record
        else:
            yield from players[record.machine].take(record)
    for player in players.values():
        yield from player.settle()


class _Player:
    """One machine that is replayed.

    Attributes:
        state: None until the first key frame.
        step: the newest replayed step, with its decisions.
        written: its recorded decisions.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.state: Any = None
        self.step: Replayed | None = None
        self.written: list[Any] = []

    def take(self, record: KeyFrame | Step | Did | Broke) -> Iterator[Found]:
        if isinstance(record, Did):
            self.written.append(record.decision)
            return
        yield from self.settle()
        if isinstance(record, KeyFrame):
            if self.state is not None and not record.was_set and comparable(self.state) != record.state:
                yield Differs(self.machine, record.now_s, (record.state,), (comparable(self.state),))
            self.state = record.state
        elif self.state is not None:
            yield from self._run(record)

    def _run(self, record: Step | Broke) -> Iterator[Found]:
        before, written = self.state, record.rule if isinstance(record, Broke) else ""
        try:
            self.state, commands = KINDS[self.machine].step(before, record.event, record.now_s)
        except (InvariantError, AssertionError) as error:
            rule, self.state = rule_of(error), None
            yield RuleBroken(self.machine, record.now_s, record.event, before, rule)
        else:
            rule = ""
            decided = tuple(decisions(self.machine, commands))
            self.step = Replayed(self.machine, record.now_s, record.event, before, self.state, decided)
            self.written = list(decided) if written else []  # nothing was decided then that could be compared
        if rule != written:
            yield Differs(self.machine, record.now_s, _rules(written), _rules(rule))

    def settle(self) -> Iterator[Found]:
        """Yield the newest step, now that all of its decisions have been read."""
        step, written = self.step, tuple(self.written)
        self.step, self.written = None, []
        if step is not None:
            yield step
            if step.decided != written:
                yield Differs(self.machine, step.now_s, written, step.decided)


def _rules(rule: str) -> tuple[str, ...]:
    return (rule,) if rule else ()
