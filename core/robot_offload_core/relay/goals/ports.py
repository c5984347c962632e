"""What a relay's shell does for its machines, and the types it uses: the holder, and the face of a server or client.

Payloads are serialized messages (CDR with its 4 bytes of encapsulation). They are not read here, except for the goal
id: bytes 4 to 20 of a SendGoal request and of a feedback message, see `wire_ids`. A `caller` names one open request of
a client: the request's identity as the middleware gave it (rmw_request_id_t, 24 bytes), never interpreted. A client
that asks twice is two callers.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, IntEnum
from typing import NamedTuple, Protocol

from robot_offload_core.words.holding import Holding

ALL_GOALS = bytes(16)
"""Goal id that asks a server to end all its goals (action_msgs/srv/CancelGoal)."""


class Face(str, Enum):
    """Whom a server of the relay serves, and which servers its clients call.

    As a server: `PUBLIC` are the clients outside the group by the public name (the robot's relay only), `GROUP` the
    nodes of this side's group that use a name served outside (both relays, by the private name).
    As a client: `GROUP` is the replica of this side by its private name (both relays), `PUBLIC` the server outside the
    group by the public name (the robot's relay only).
    """

    PUBLIC = "public"
    GROUP = "group"


class GoalStatus(IntEnum):
    """`action_msgs/msg/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def ended(self) -> bool:
        """The goal has a result."""
        return self >= GoalStatus.SUCCEEDED


class CancelCode(IntEnum):
    """`action_msgs/srv/CancelGoal`, the response's return code."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL = 2
    TERMINATED = 3


class GoalEntry(NamedTuple):
    """A goal as status messages and answers to cancels show it."""

    goal_id: bytes
    stamp_ns: int
    status: GoalStatus = GoalStatus.UNKNOWN


class RelayPorts(Protocol):
    """What the shell of either relay does. No call may block or call the relay back before it returns."""

    def now_s(self) -> float:
        """Return the steady clock, seconds (CLOCK_BOOTTIME, as the other processes)."""

    def wall_ns(self) -> int:
        """Return the system clock, nanoseconds: the stamp of accepted goals."""

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent ("control", "data", "collector")."""

    def warn(self, message: str) -> None:
        """Log a warning."""

    # -- as a client of servers ---------------------------------------------------------------------------------------

    def offer(self, face: Face, action: str, payload: bytes) -> None:
        """Call `send_goal`; the goal id is in the payload. The answer comes back as `offer_answered`."""

    def cancel(self, face: Face, action: str, goal_id: bytes) -> None:
        """Call `cancel_goal` for one goal (stamp 0). The answer comes back as `cancel_answered`."""

    def ask_result(self, face: Face, action: str, goal_id: bytes) -> None:
        """Call `get_result`. The answer comes back as `result_arrived`, whenever the goal ends."""

    def call(self, face: Face, service: str, key: int, payload: bytes) -> None:
        """Call a service. The answer, if there is one, comes back as `call_answered` with the same key."""

    def forget_call(self, key: int) -> None:
        """Drop a call: its answer is no longer needed."""

    # -- as a server of clients ---------------------------------------------------------------------------------------

    def answer_goal(self, face: Face, action: str, caller: bytes, accepted: bool, stamp_ns: int) -> None:
        """Answer a `send_goal`."""

    def answer_cancel(
        self, face: Face, action: str, caller: bytes, code: CancelCode, goals: Sequence[GoalEntry]
    ) -> None:
        """Answer a `cancel_goal` with the goals that will be cancelled."""

    def answer_result(self, face: Face, action: str, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        """Answer a `get_result`. `payload`: the server's whole response; b"": a default one with `status`.

        Where a payload is given, its status (byte 4) is `status` already.
        """

    def publish_feedback(self, face: Face, action: str, payload: bytes) -> None:
        """Publish a feedback message as it is."""

    def publish_status(self, face: Face, action: str, goals: Sequence[GoalEntry]) -> None:
        """Publish the status array of an action (latched)."""

    def answer_call(self, face: Face, service: str, caller: bytes, payload: bytes) -> None:
        """Answer a service call with the server's response."""

    def fail_call(self, face: Face, service: str, caller: bytes, reason: str, message: str) -> None:
        """Answer a service call without a server's response, or drop it.

        If the response has a boolean `success`, a default response with `message` in its `message` is sent. Otherwise
        nothing is sent (a ROS service has no errors); the shell only logs and forgets the caller.
        """


class RobotRelayPorts(RelayPorts, Protocol):
    """What the shell of the robot's relay does in addition."""

    def holder(self) -> Holding:
        """Read the collector's memory, now. If it is torn or missing, read it again, then use the last good value."""

    def keep(self, record: bytes) -> bool:
        """Append a record to the journal; return False if there is no room for it."""

    def compact(self, records: Sequence[bytes]) -> bool:
        """Replace the whole journal, at once or not at all; return False if there is no room for that."""


class CloudRelayPorts(RelayPorts, Protocol):
    """What the shell of the cloud's relay does in addition."""

    def call_member(self, service: str, member: str, key: int, payload: bytes) -> None:
        """Call a service at one pod of a pool; the answer comes back as that of `call`."""
