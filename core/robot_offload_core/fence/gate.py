"""Which message reaches the consumers: never two sides in one stay, never an older stay again, nothing too old.

A token is accepted by equality only. Control names the side in charge and, while another side gets ready, the next one.
The gate changes over to the next side when its caller asks, and never goes back. When control is silent for too long,
the robot passes and the cloud does not, until control names a newer epoch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.freshness import fresh
from robot_offload_core.fence.token import Site, Token


@dataclass(frozen=True)
class Charge:
    """One stay in charge: a site and the token it acts under."""

    site: Site
    token: Token


@dataclass(frozen=True)
class Word:
    """An order of control to the gate.

    Attributes:
        started_us: when this control process started; a later start outranks an earlier one.
        current: the side in charge.
        next: the side that may take over; None for none.
        said_s: when control sent it. A word may have waited in an inbox.
        presence: token of the outputs of nodes with placement Cloud; None: none of them passes.
    """

    started_us: int
    current: Charge
    next: Charge | None
    said_s: float
    presence: Token | None = None


@dataclass(frozen=True)
class Known:
    """What the caller knows about the side that sent a message; if one attribute is false, that side passes nothing.

    Attributes:
        alone: the public topic has no other publisher that would interfere with a message of this side.
        single: the private topic of this side has only one producer.
        types_equal: the message has the type that the consumers expect.
    """

    alone: bool = True
    single: bool = True
    types_equal: bool = True


class Ruling(str, Enum):
    """How a message is judged; `docs/reference/reasons.md` explains the words."""

    ROBOT_IN_CHARGE = "RobotInCharge"
    CURRENT = "Current"
    PRESENT = "Present"
    NOT_ALL_READY = "NotAllReady"
    CLOUD_IN_CHARGE = "CloudInCharge"
    CONTROL_SILENT = "ControlSilent"
    STALE = "Stale"
    BEFORE_RESTART = "BeforeRestart"
    REORDERED = "Reordered"
    FOREIGN_TOKEN = "ForeignToken"  # noqa: S105 - a word, not a secret
    SECOND_PUBLISHER = "SecondPublisher"
    TWO_REPLICAS = "TwoReplicas"
    TYPES_DIFFER = "TypesDiffer"

    @property
    def passes(self) -> bool:
        """Return whether the message reaches the consumers."""
        return self in _PASSES


_PASSES = frozenset({Ruling.ROBOT_IN_CHARGE, Ruling.CURRENT, Ruling.PRESENT})
EVERYTHING = Known()


@dataclass(frozen=True)
class Held:
    """The newest message of the side that gets ready: its sequence, and from when its age counts."""

    sequence: int
    born_s: float


@dataclass(frozen=True)
class Gate:
    """State of the gate. Times on this host's steady clock, seconds.

    Attributes:
        max_age_s: oldest message of the cloud that passes.
        silence_s: silence of control after which only the robot passes.
        passed: sequence of the cloud's newest message that passed in this stay, per output; -1 for none.
        held: see Held, per output.
        results: token and sequence of the newest message of a node with placement Cloud, per output.
        charge: the charge that passes; None before control's first word (the robot passes then).
        next, started_us, said_s, presence: of control's newest word.
        fell_back: control fell silent; only the robot passes until control names a newer epoch.
        resumed_s: when this process continued from the record of a predecessor; None without one.
    """

    max_age_s: float
    silence_s: float
    passed: tuple[int, ...]
    held: tuple[Held | None, ...]
    results: tuple[tuple[Token, int] | None, ...]
    charge: Charge | None = None
    next: Charge | None = None
    started_us: int = -1
    said_s: float | None = None
    presence: Token | None = None
    fell_back: bool = False
    resumed_s: float | None = None


def start(outputs: int, max_age_s: float, silence_s: float) -> Gate:
    """Return a gate for this number of outputs; it passes the robot until control's first word."""
    return Gate(max_age_s, silence_s, (-1,) * outputs, (None,) * outputs, (None,) * outputs)


def resume(gate: Gate, charge: Charge, started_us: int, fell_back: bool, now_s: float) -> Gate:
    """Continue from the state that a predecessor had reached.

    Nothing of the cloud passes before control's first word, nor anything sent before `now_s`: the predecessor may have
    passed it. Silence counts from now.
    """
    return replace(gate, charge=charge, started_us=started_us, fell_back=fell_back, resumed_s=now_s)


def limit(gate: Gate, max_age_s: float, silence_s: float) -> Gate:
    """Return the gate with changed limits; safe at any moment, they only determine what is refused."""
    return replace(gate, max_age_s=max_age_s, silence_s=silence_s)


# -- words of control -------------------------------------------------------------------------------------------------


def order(gate: Gate, word: Word, now_s: float) -> Gate:
    """Take a word of control. It only moves forward: an epoch already left behind is never entered again."""
    if word.started_us < gate.started_us:
        return gate
    same_control, ours, theirs = word.started_us == gate.started_us, gate.charge, word.current
    gate = replace(gate, started_us=word.started_us, said_s=min(word.said_s, now_s), presence=word.presence)
    if ours is None or not same_control or theirs.token.epoch > ours.token.epoch:
        return _enter(gate, theirs, word.next)
    if theirs.token.epoch < ours.token.epoch:
        return gate  # already changed over to what control still calls next
    if gate.fell_back and ours.site is Site.CLOUD:
        return gate  # the robot has passed since: only a newer epoch may follow
    return _arm(replace(gate, fell_back=False), word.next)


def tick(gate: Gate, now_s: float) -> Gate:
    """Fall back to the robot when control has been silent for too long."""
    spoken_s = gate.resumed_s if gate.said_s is None else gate.said_s
    if gate.fell_back or spoken_s is None or now_s - spoken_s <= gate.silence_s:
        return gate
    return replace(gate, fell_back=True, next=None, held=_nothing(gate))


def take_over(gate: Gate, now_s: float) -> Gate:
    """Change over to the side that got ready; `release` then returns which of its held messages pass."""
    gate = tick(gate, now_s)
    if gate.next is None:
        return gate
    return replace(gate, charge=gate.next, next=None, fell_back=False, passed=_sequences(gate))


def _enter(gate: Gate, charge: Charge, following: Charge | None) -> Gate:
    passed = _sequences(gate) if charge == gate.next else (-1,) * len(gate.passed)
    gate = replace(gate, charge=charge, next=None, fell_back=False, passed=passed, held=_nothing(gate))
    return _arm(gate, following)


def _arm(gate: Gate, following: Charge | None) -> Gate:
    if following == gate.next or gate.charge is None:
        return gate
    if following is not None and following.token.epoch <= gate.charge.token.epoch:
        following = None  # only what is newer may follow
    return replace(gate, next=following, held=_nothing(gate))


def _sequences(gate: Gate) -> tuple[int, ...]:
    return tuple(-1 if held is None else held.sequence for held in gate.held)


def _nothing(gate: Gate) -> tuple[None, ...]:
    return (None,) * len(gate.held)


# -- messages ---------------------------------------------------------------------------------------------------------


def robot(gate: Gate, output: int, now_s: float, known: Known = EVERYTHING) -> tuple[Gate, Ruling]:
    """Judge a message of the robot's replica; if NOT_ALL_READY, it is held until `take_over`."""
    gate = tick(gate, now_s)
    fault = _fault(known)
    if fault is not None:
        return gate, fault
    if site(gate) is Site.ROBOT:
        return _hold(gate, output, None), Ruling.ROBOT_IN_CHARGE
    if gate.next is None or gate.next.site is not Site.ROBOT:
        return gate, Ruling.CLOUD_IN_CHARGE
    return _hold(gate, output, Held(-1, now_s)), Ruling.NOT_ALL_READY


def cloud(
    gate: Gate, output: int, header: Envelope, now_s: float, known: Known = EVERYTHING, *, lasts: bool = False
) -> tuple[Gate, Ruling]:
    """Judge a message of the cloud's replica; with `lasts` (last value of a latched topic) its age does not count."""
    gate = tick(gate, now_s)
    fault = _fault(known)
    if fault is not None:
        return gate, fault
    if gate.fell_back or gate.charge is None or gate.said_s is None:
        return gate, Ruling.CONTROL_SILENT
    if not fresh(header.age_s(now_s), math.inf if lasts else gate.max_age_s):
        return gate, Ruling.STALE
    if _before_restart(gate, header) and not lasts:
        return gate, Ruling.BEFORE_RESTART
    charge = Charge(Site.CLOUD, header.token)
    if charge == gate.charge:
        if header.sequence <= gate.passed[output]:
            return gate, Ruling.REORDERED
        passed = (*gate.passed[:output], header.sequence, *gate.passed[output + 1 :])
        return replace(_hold(gate, output, None), passed=passed), Ruling.CURRENT
    if charge == gate.next:
        held = gate.held[output]
        if held is not None and header.sequence <= held.sequence:
            return gate, Ruling.REORDERED
        born_s = now_s if lasts else header.echo_us / 1e6
        return _hold(gate, output, Held(header.sequence, born_s)), Ruling.NOT_ALL_READY
    return gate, Ruling.FOREIGN_TOKEN


def release(gate: Gate, output: int, now_s: float, known: Known = EVERYTHING) -> tuple[Gate, bool]:
    """Return whether the held message of an output passes after `take_over`: once, and only while fresh."""
    gate = tick(gate, now_s)
    held = gate.held[output]
    if held is None or gate.next is not None:
        return gate, False
    passes = _fault(known) is None and fresh(now_s - held.born_s, gate.max_age_s)
    return _hold(gate, output, None), passes


def result(
    gate: Gate, output: int, header: Envelope, now_s: float, max_age_s: float, known: Known = EVERYTHING
) -> tuple[Gate, Ruling]:
    """Judge a message of a node with placement Cloud by the presence token; it passes whichever side is in charge."""
    fault = _fault(known)
    if fault is not None:
        return gate, fault
    if gate.said_s is None or now_s - gate.said_s > gate.silence_s:
        return gate, Ruling.CONTROL_SILENT
    if gate.presence is None or header.token != gate.presence:
        return gate, Ruling.FOREIGN_TOKEN
    if not fresh(header.age_s(now_s), max_age_s):
        return gate, Ruling.STALE
    if _before_restart(gate, header):
        return gate, Ruling.BEFORE_RESTART
    newest = gate.results[output]
    if newest is not None and newest[0] == header.token and header.sequence <= newest[1]:
        return gate, Ruling.REORDERED
    results = (*gate.results[:output], (header.token, header.sequence), *gate.results[output + 1 :])
    return replace(gate, results=results), Ruling.PRESENT


def effect(gate: Gate, token: Token, now_s: float) -> Ruling:
    """Judge an effect of the cloud that no gate collects: only the side in charge is admitted."""
    gate = tick(gate, now_s)
    if gate.fell_back or gate.charge is None or gate.said_s is None:
        return Ruling.CONTROL_SILENT
    return Ruling.CURRENT if gate.charge == Charge(Site.CLOUD, token) else Ruling.FOREIGN_TOKEN


def _hold(gate: Gate, output: int, held: Held | None) -> Gate:
    if held == gate.held[output]:
        return gate
    return replace(gate, held=(*gate.held[:output], held, *gate.held[output + 1 :]))


def _before_restart(gate: Gate, header: Envelope) -> bool:
    return gate.resumed_s is not None and header.echo_us / 1e6 <= gate.resumed_s


def _fault(known: Known) -> Ruling | None:
    if not known.alone:
        return Ruling.SECOND_PUBLISHER
    if not known.single:
        return Ruling.TWO_REPLICAS
    return None if known.types_equal else Ruling.TYPES_DIFFER


# -- for other modules ------------------------------------------------------------------------------------------------


def site(gate: Gate) -> Site:
    """Return the side that passes: the robot also before control has spoken and after falling back."""
    return Site.ROBOT if gate.charge is None or gate.fell_back else gate.charge.site
