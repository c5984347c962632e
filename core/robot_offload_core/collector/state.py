"""What the collector remembers: of each output, and of who passes."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.collector.lateness import UNHEARD, Lateness
from robot_offload_core.words.gates import Charge
from robot_offload_core.words.settings import OutputSpec
from robot_offload_core.words.token import Token


@dataclass(frozen=True)
class OutputState:
    """Per output: newest messages of each side, and the last sequence passed under the present token.

    `next_*` is about the newest message of the side that gets ready, which is held until the changeover: its sequence,
    its arrival, and from when its age counts. `present` is the newest message that passed of a node with placement
    Cloud: its token and sequence; `stale` that its newest message was too old to pass. `standby_s` is when the newest
    message of a Hot replica on the robot came, `standby_new` that consumers have not heard it, or have heard the cloud
    since. `late`: how late the cloud's messages come; `floor_s`: least margin with which they are waited for (Gate).
    `robot_while_s`, `cloud_while_s`: since when `while` is true on that side; None while it is not.
    """

    spec: OutputSpec
    last_sequence: int = -1
    next_sequence: int = -1
    next_ready_s: float | None = None
    next_born_s: float = 0.0
    robot_s: float | None = None
    cloud_s: float | None = None
    present: tuple[Token, int] | None = None
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
        max_age_s: oldest cloud message that passes.
        gate_timeout_s: silence of control after which only the robot passes.
        outputs: one state per collected output, in the order of the configuration.
        charge: who passes; None before control has spoken for the first time (the robot passes then).
        next: see Gate.
        started_us: of the control process listened to.
        gate_s: when control last spoke to this process; None before.
        resumed_s: when this process took up what its predecessor had reached; None when it had none.
        fell_back: control went silent; only the robot passes until a new epoch is named.
        flipped_s: when the last changeover took place.
        acts_s: since when the side that passes now has passed, under whatever epochs.
        presence, prompt: see Gate.
        turned_s: the last turn of this process. judged_from_s: silence is not reported before, see `turn`.
        stay: grows by one with each change of the side that passes, over restarts of this process.
        loss_timeout_s: longest margin with which a message of the cloud is waited for; 0: none is.
        activation_s: by when an output speaks whose `while` became true.
        paused_s: end of the last pause of this process.
    """

    max_age_s: float
    gate_timeout_s: float
    outputs: tuple[OutputState, ...]
    charge: Charge | None = None
    next: Charge | None = None
    started_us: int = -1
    gate_s: float | None = None
    resumed_s: float | None = None
    fell_back: bool = False
    flipped_s: float | None = None
    acts_s: float | None = None
    presence: Token | None = None
    prompt: bool = False
    turned_s: float | None = None
    judged_from_s: float = 0.0
    paused_s: float | None = None
    stay: int = 0
    loss_timeout_s: float = 0.0
    activation_s: float = 0.0
