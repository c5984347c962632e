"""What the collector remembers: of each output, and of who passes."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.collector.lateness import UNHEARD, Lateness
from robot_offload_core.fence import gate as fence
from robot_offload_core.fence.gate import Charge
from robot_offload_core.words.settings import OutputSpec


@dataclass(frozen=True)
class OutputState:
    """Per output: newest messages of each side; which of them pass is for the fence to know.

    `next_ready_s` is when the newest message came of the side that gets ready, which is held until the changeover.
    `stale` says of a node with placement Cloud that its newest message was too old to pass. `standby_s` is when the
    newest message of a Hot replica on the robot came, `standby_new` that consumers have not heard it, or have heard
    the cloud since. `late`: how late the cloud's messages come; `floor_s`: least margin with which they are waited for
    (Gate).
    `robot_while_s`, `cloud_while_s`: since when `while` is true on that side; None while it is not.
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
        fence: who passes, and what has passed; only functions of the fence change it.
        outputs: one state per collected output, in the order of the configuration.
        flipped_s: when the last changeover took place.
        acts_s: since when the side that passes now has passed, under whatever epochs.
        prompt: see Gate.
        turned_s: the last turn of this process.
        judged_from_s: silence is not reported before, see `turn`.
        stay: grows by one with each change of the side that passes, over restarts of this process.
        loss_timeout_s: longest margin with which a message of the cloud is waited for; 0: none is.
        activation_s: by when an output speaks whose `while` became true.
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
        """Who passes; None before control has spoken for the first time (the robot passes then)."""
        return self.fence.charge

    @property
    def next(self) -> Charge | None:
        """See Gate."""
        return self.fence.next

    @property
    def started_us(self) -> int:
        """Start of the control process listened to."""
        return self.fence.started_us

    @property
    def gate_s(self) -> float | None:
        """When control last spoke to this process; None before."""
        return self.fence.said_s

    @property
    def resumed_s(self) -> float | None:
        """When this process took up what its predecessor had reached; None when it had none."""
        return self.fence.resumed_s

    @property
    def fell_back(self) -> bool:
        """Control went silent; only the robot passes until a new epoch is named."""
        return self.fence.fell_back

    @property
    def max_age_s(self) -> float:
        """Oldest message of the cloud that passes."""
        return self.fence.max_age_s

    @property
    def gate_timeout_s(self) -> float:
        """Silence of control after which only the robot passes."""
        return self.fence.silence_s
