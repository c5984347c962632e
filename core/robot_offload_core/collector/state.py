"""The collector's state: of each output, and which side passes."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.collector.lateness import UNHEARD, Lateness
from robot_offload_core.fence import gate as fence
from robot_offload_core.fence.gate import Charge
from robot_offload_core.words.settings import OutputSpec


@dataclass(frozen=True)
class OutputState:
    """State of one output; which messages pass is known to the fence alone.

    Attributes:
        spec: from the configuration.
        next_ready_s: arrival of the newest message of the side that gets ready; it is held until the changeover.
        robot_s, cloud_s: arrival of the newest message of each side.
        stale: the newest message of a node with placement Cloud was too old to pass.
        standby_s: arrival of the newest message of a Hot replica on the robot.
        standby_new: consumers have not received that message, or have received one of the cloud since.
        late: how late the cloud's messages come.
        floor_s: least margin for them (Gate).
        robot_while_s, cloud_while_s: since when `while` is true on that side; None while it is not.
    """

    spec: OutputSpec
    next_ready_s: float | None = None
    robot_s: float | None = None
    cloud_s: float | None = None
    stale: bool = False
    standby_s: float | None = None
    standby_new: bool = False
    late: Lateness = UNHEARD
    floor_s: float = 0.0
    robot_while_s: float | None = None
    cloud_while_s: float | None = None


@dataclass(frozen=True)
class Collector:
    """State of the collector.

    Attributes:
        fence: which side passes, and what has passed; only functions of the fence change it.
        outputs: one state per collected output, in the order of the configuration.
        flipped_s: when the last changeover took place.
        acts_s: since when the side that passes now has passed, over all its epochs.
        prompt: see Gate.
        turned_s: the last turn of this process.
        judged_from_s: silence is not reported before this time, see `turn`.
        stay: grows by one with each change of the side that passes, over restarts of this process.
        loss_timeout_s: margin for messages of the cloud until their lateness is known; 0: no message is expected.
        activation_s: time in which an output must publish after its `while` became true.
        paused_s: end of the last pause of this process.
    """

    fence: fence.Gate
    outputs: tuple[OutputState, ...]
    flipped_s: float | None = None
    acts_s: float | None = None
    prompt: bool = False
    turned_s: float | None = None
    judged_from_s: float = 0.0
    paused_s: float | None = None
    stay: int = 0
    loss_timeout_s: float = 0.0
    activation_s: float = 0.0

    @property
    def charge(self) -> Charge | None:
        """The charge that passes; None before control's first order (the robot passes then)."""
        return self.fence.charge

    @property
    def next(self) -> Charge | None:
        """See Gate."""
        return self.fence.next

    @property
    def started_us(self) -> int:
        """Start of the control process whose orders count."""
        return self.fence.started_us

    @property
    def gate_s(self) -> float | None:
        """When control sent its last order to this process; None before the first."""
        return self.fence.said_s

    @property
    def resumed_s(self) -> float | None:
        """When this process continued from its predecessor's state; None without a predecessor."""
        return self.fence.resumed_s

    @property
    def fell_back(self) -> bool:
        """Control fell silent; only the robot passes until control names a new epoch."""
        return self.fence.fell_back

    @property
    def max_age_s(self) -> float:
        """Oldest message of the cloud that passes."""
        return self.fence.max_age_s

    @property
    def gate_timeout_s(self) -> float:
        """Silence of control after which only the robot passes."""
        return self.fence.silence_s
