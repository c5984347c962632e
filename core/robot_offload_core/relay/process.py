"""The relays of both sides as their shell sees them: events come in by these methods, orders go out by ports.

All calls come from one thread. After each call, and when `due_s` has passed, the shell calls `turn`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalStatus
from robot_offload_core.relay.post import Post
from robot_offload_core.words.declared import ActionSpec, ServiceSpec, UsedAction, UsedService
from robot_offload_core.words.messages import RelayStatus
from robot_offload_core.words.replace import replace

JOURNAL_BYTES = 24 * 1024 * 1024
"""Size of the journal's memory file."""
MAX_PAYLOAD = 1024 * 1024
"""Most bytes of a request, a goal, a feedback message or a result; larger ones are refused and counted by name."""
STATUS_S = 0.1
"""Interval of the status to control, in addition to those at changes."""


@dataclass(frozen=True)
class RelayPlan:
    """What the configuration declares for the relay.

    Attributes:
        services, actions: served by the group.
        used_services, used_actions: served outside the group.
        prepare_deadline_s: how long an offer waits at most for the holder to be able.
        cancel_deadline_s: how long the old side's goals and requests may take to end after a change of the holder.
        lease_s: longest time that the cloud acts after its last grant.
    """

    services: tuple[ServiceSpec, ...] = ()
    actions: tuple[ActionSpec, ...] = ()
    used_services: tuple[UsedService, ...] = ()
    used_actions: tuple[UsedAction, ...] = ()
    prepare_deadline_s: float = 5.0
    cancel_deadline_s: float = 2.0
    lease_s: float = 0.250


class RelayProcess(ABC):
    """Either relay.

    `face` and `name` (the public name) identify the server or client of the shell; see `Face`.
    """

    @property
    @abstractmethod
    def due_s(self) -> float:
        """When `turn` has something to do, on the steady clock."""

    @abstractmethod
    def turn(self) -> None:
        """Do what is due: repeat what was not acknowledged, end what timed out, report."""

    # -- messages -----------------------------------------------------------------------------------------------------

    @abstractmethod
    def handle(self, message: object) -> None:
        """Take a message of another process of this agent: RelayOrders or Egress of control, Letters of data."""

    # -- this side's graph --------------------------------------------------------------------------------------------

    @abstractmethod
    def servers_seen(self, servers: Iterable[tuple[Face, str, str]]) -> None:
        """Take the servers in the graph that this relay calls: (face, public name, endpoints).

        To be called at changes and once a second. `endpoints` is any text that changes when the server was started
        again (the sorted gids of its request readers): a server that changed has forgotten its goals.
        """

    # -- answers of servers -------------------------------------------------------------------------------------------

    @abstractmethod
    def offer_answered(self, face: Face, name: str, goal_id: bytes, accepted: bool) -> None:
        """Take a server's answer to `send_goal`."""

    @abstractmethod
    def cancel_answered(self, face: Face, name: str, goal_id: bytes, code: CancelCode) -> None:
        """Take a server's answer to `cancel_goal`."""

    @abstractmethod
    def result_arrived(self, face: Face, name: str, goal_id: bytes, status: GoalStatus, payload: bytes) -> None:
        """Take a server's answer to `get_result` (`UNKNOWN`: it does not know the goal) with its whole response."""

    @abstractmethod
    def feedback_arrived(self, face: Face, name: str, payload: bytes) -> None:
        """Take feedback that a server has published."""

    @abstractmethod
    def call_answered(self, key: int, payload: bytes, success: bool = True) -> None:
        """Take a server's answer to a call; `success` is False if the response has a field `success` that is false."""

    # -- requests of clients ------------------------------------------------------------------------------------------

    @abstractmethod
    def goal_requested(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Take a client's call of `send_goal`."""

    @abstractmethod
    def cancel_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes, stamp_ns: int) -> None:
        """Take a client's call of `cancel_goal`; zero id and stamp 0 mean all goals (action_msgs/srv/CancelGoal)."""

    @abstractmethod
    def result_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes) -> None:
        """Take a client's call of `get_result`."""

    @abstractmethod
    def called(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Take a client's call of a service."""


def status_problems(
    status: RelayStatus, post: Post, counters: Counter[str], levels: Mapping[str, int] = MappingProxyType({})
) -> RelayStatus:
    """Return the status with what diagnostics show; `levels`: numbers of what is open now, zeros included."""
    problems = (post.problem,) if post.problem is not None else ()
    counted = tuple(sorted({**(counters + post.counters), **levels}.items()))
    return replace(status, problems=problems, counters=counted)
