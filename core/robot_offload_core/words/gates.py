"""The words of the gate: control's order to the collector, the ruling on a message, the collector's report."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence import gate as fence
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Token
from robot_offload_core.words.reasons import Explained
from robot_offload_core.words.settings import OutputSpec


@dataclass(frozen=True)
class Gate:
    """Control's order to the collector, renewed every beat period.

    Attributes:
        started_us: when control started; a later start outranks an earlier one.
        current: the side in charge.
        next: the side that gets ready and may take over at its first messages; None otherwise.
        said_s: when control sent it, on this host's steady clock; None: now. A gate may have waited in the inbox of a
            stopped collector.
        presence: token of the outputs of nodes with placement Cloud (results.py); None: none of them passes.
        prompt: the active side cannot or must not act, so the change does not wait for slow outputs of `next`
            (slow_outputs.py).
        robot_while, cloud_while: the outputs, by index, whose `while` is true on that side.
        floors: (output index, least margin after a period before its next message counts as lost, seconds), because a
            shorter silence of the output was once mistaken for a loss (fast_takeover.py).
    """

    started_us: int
    current: Charge
    next: Charge | None = None
    said_s: float | None = None
    presence: Token | None = None
    prompt: bool = False
    robot_while: tuple[int, ...] = ()
    cloud_while: tuple[int, ...] = ()
    floors: tuple[tuple[int, float], ...] = ()


class Ruling(Explained):
    """Why a message passes, or not."""

    ROBOT_IN_CHARGE = "RobotInCharge", "The robot is in charge"
    CURRENT = "Current", "The cloud is in charge and the message carries its token"
    PRESENT = "Present", "It is of a node with placement Cloud, which passes whoever is in charge"
    CHANGED_OVER = "ChangedOver", "With this message the new side took over"
    RELEASED = "Released", "The robot took over: the newest message of its Hot replica, kept until then, passes"
    NOT_ALL_READY = (
        "NotAllReady",
        "The side that gets ready published, other rated outputs of it do not flow yet: kept, the newest per output",
    )
    CLOUD_IN_CHARGE = "CloudInCharge", "The cloud is in charge, the robot's message is left out"
    CONTROL_SILENT = "ControlSilent", "Control has not spoken for a lease, or not yet"
    STALE = "Stale", "The message is older than `maxCommandAge`, or echoes nobody here"
    BEFORE_RESTART = "BeforeRestart", "The message was sent before this collector started"
    REORDERED = "Reordered", "A newer message of the same output was heard before"
    FOREIGN_TOKEN = "ForeignToken", "The message carries another token than the side in charge"
    SECOND_PUBLISHER = "SecondPublisher", "The public topic has another publisher"
    TWO_REPLICAS = "TwoReplicas", "Two producers speak on the private topic of the side"
    TYPES_DIFFER = "TypesDiffer", "The message is of another type than the consumers get"

    @property
    def passes(self) -> bool:
        """Return whether the message reaches the consumers."""
        return self in _PASSES

    @staticmethod
    def of(ruling: fence.Ruling) -> Ruling:
        """Return the word for a ruling of the fence."""
        return _RULINGS[ruling.value]


_PASSES = frozenset({Ruling.ROBOT_IN_CHARGE, Ruling.CURRENT, Ruling.PRESENT, Ruling.CHANGED_OVER, Ruling.RELEASED})
_RULINGS = {word.value: word for word in Ruling}


@dataclass(frozen=True)
class Passage:
    """Whether a message passes.

    Attributes:
        reason: why it passes, or not. With `NOT_ALL_READY` it must be kept, as it may pass at the changeover.
        also: with `CHANGED_OVER`: outputs whose kept message passes now too, before this one; drop the others.
    """

    reason: Ruling
    also: tuple[int, ...] = ()

    @property
    def passes(self) -> bool:
        """Return whether to publish the message."""
        return self.reason.passes


@dataclass(frozen=True)
class GateReport:
    """What the collector reports to control.

    Attributes:
        charge: the charge that passes now; None before the first gate.
        fell_back: see Collector.
        robot_flows: every rated output has a message of the robot's replica within its deadline, or is not judged yet.
        cloud_flows: the same for messages of the cloud with the current (or next) token.
        robot_flowing: the rated outputs, by index, with a message of the robot's replica within the deadline, without
            any grace.
        cloud_flowing: the outputs with a deadline, by index, with a message of the cloud within it, including those of
            nodes with placement Cloud.
        stale: the outputs of nodes with placement Cloud, by index, whose newest message was too old to pass.
        robot_silent, cloud_silent: the rated outputs, by index, that do not flow.
        idle: the rated outputs, by index, that need not publish on the robot now (`while`).
        missed: (index, due time) of outputs whose next message of the cloud is lost, while the robot's Hot replica has
            published.
    """

    charge: Charge | None
    fell_back: bool
    robot_flows: bool
    cloud_flows: bool
    robot_flowing: tuple[int, ...] = ()
    cloud_flowing: tuple[int, ...] = ()
    stale: tuple[int, ...] = ()
    robot_silent: tuple[int, ...] = ()
    cloud_silent: tuple[int, ...] = ()
    idle: tuple[int, ...] = ()
    missed: tuple[tuple[int, float], ...] = ()

    @staticmethod
    def names(indices: tuple[int, ...], outputs: tuple[OutputSpec, ...]) -> tuple[str, ...]:
        """Return the names of the known ones among these outputs."""
        if not indices:
            return ()
        return tuple(outputs[i].shown for i in indices if i < len(outputs))
