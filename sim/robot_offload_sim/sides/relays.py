"""The relays of both sides in virtual time: the core's own classes around the servers of the simulated nodes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.cloud import CloudRelay
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalEntry, GoalStatus
from robot_offload_core.relay.goals.wire_ids import goal_id_of
from robot_offload_core.relay.process import RelayPlan, RelayProcess
from robot_offload_core.relay.robot import RobotRelay
from robot_offload_core.words.holding import Holding
from robot_offload_sim.sides.shells import SLACK_S, Shell
from robot_offload_sim.world.ports import Surroundings
from robot_offload_sim.world.servers import Servers
from robot_offload_sim.world.world import Host

GRAPH_S = 0.1
OUTSIDE_S = 0.004
TURN_LEAST_S = 0.002


class RelayShell(Shell):
    """The common part of both relays' shells.

    Attributes:
        servers: servers of this side.
        clients: receivers of the relay's answers (the robot's only).
        outside: takes a call at a used service outside the group: (site, service, payload).
        beyond: the action server outside, and its clients in the group.
    """

    process: RelayProcess

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell], plan: RelayPlan) -> None:
        super().__init__(around, host, "relay", peers)
        self.plan = plan
        self.servers: Servers
        self.clients: Any = None
        self.outside: Any = None
        self.beyond: Any = None

    def make(self, incarnation: str) -> RelayProcess:
        """Return the core's process of this side."""
        raise NotImplementedError

    def boot(self) -> None:
        """Start a new process."""
        self.process = self.make(f"{self.world.dice.getrandbits(128):032x}")
        self.every(GRAPH_S, self._look, first_s=0.05)
        self.once(0.0, self._turn)

    def _look(self) -> None:
        self.process.servers_seen(self.servers.seen() + self._seen_beyond())

    def _seen_beyond(self) -> list[tuple[Face, str, str]]:
        return []

    def _at(self, face: Face) -> Servers:
        servers: Servers = self.servers if face is Face.GROUP else self.beyond.servers
        return servers

    def _turn(self) -> None:
        self.process.turn()
        slack_s = self.world.dice.random() * SLACK_S
        self.once(max(TURN_LEAST_S, self.process.due_s - self.host.now_s()) + slack_s, self._turn)

    def take(self, message: object) -> None:
        """Take a datagram of another process."""
        self.process.handle(message)
        self._soon()

    def _soon(self) -> None:
        if self.process.due_s <= self.host.now_s():
            self.process.turn()

    def _then(self, name: str, *words: Any) -> None:
        getattr(self.process, name)(*words)
        self._soon()

    def wall_ns(self) -> int:
        """Return the system clock, nanoseconds."""
        return round(self.host.now_s() * 1e9) + self.host.wall_us * 1000

    def warn(self, message: str) -> None:
        """Keep a warning for the story."""
        self.world.note(self.name, message)

    # -- as a client of servers ---------------------------------------------------------------------------------------

    def offer(self, face: Face, action: str, payload: bytes) -> None:
        """Call send_goal."""
        if face is Face.PUBLIC:
            self.beyond.offered(goal_id_of(payload))
        self._at(face).offer(
            self, action, payload, partial(self._then, "offer_answered", face, action, goal_id_of(payload))
        )

    def cancel(self, face: Face, action: str, goal_id: bytes) -> None:
        """Call cancel_goal."""
        self._at(face).cancel(self, action, goal_id, partial(self._then, "cancel_answered", face, action, goal_id))

    def ask_result(self, face: Face, action: str, goal_id: bytes) -> None:
        """Call get_result."""
        self._at(face).ask_result(self, action, goal_id, partial(self._then, "result_arrived", face, action, goal_id))

    def call(self, face: Face, service: str, key: int, payload: bytes) -> None:
        """Call a service of this side's replica, or one outside the group."""
        if face is Face.PUBLIC:
            self.outside(service, payload)
            self.world.after(OUTSIDE_S, self.post, "outside", self._then, "call_answered", key, payload)
        else:
            self.servers.call(self, service, payload, partial(self._then, "call_answered", key))

    def call_member(self, service: str, member: str, key: int, payload: bytes) -> None:
        """Call a service at one pod; the simulated nodes have one pod each."""
        self.call(Face.GROUP, service, key, payload)

    def forget_call(self, key: int) -> None:
        """Do nothing: the core ignores answers that are no longer wanted."""

    def feed(self, action: str, payload: bytes) -> None:
        """Take feedback of a server here."""
        self.post("feedback", self._then, "feedback_arrived", Face.GROUP, action, payload)

    # -- as a server --------------------------------------------------------------------------------------------------

    def answer_goal(self, face: Face, action: str, caller: bytes, accepted: bool, stamp_ns: int) -> None:
        """Answer a client."""
        if face is Face.GROUP:
            self.beyond.accepted(caller, accepted)
        else:
            self.clients.accepted(caller, accepted, stamp_ns)

    def answer_cancel(
        self, face: Face, action: str, caller: bytes, code: CancelCode, goals: Sequence[GoalEntry]
    ) -> None:
        """Answer a client."""
        if face is Face.PUBLIC:
            self.clients.cancelled(caller, code, tuple(goals))

    def answer_result(self, face: Face, action: str, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        """Answer a client."""
        if face is Face.GROUP:
            self.beyond.result(caller, status)
        else:
            self.clients.result(caller, status, payload)

    def publish_feedback(self, face: Face, action: str, payload: bytes) -> None:
        """Publish to the clients."""
        (self.beyond if face is Face.GROUP else self.clients).fed(payload)

    def publish_status(self, face: Face, action: str, goals: Sequence[GoalEntry]) -> None:
        """Do nothing: clients here do not read the status."""

    def answer_call(self, face: Face, service: str, caller: bytes, payload: bytes) -> None:
        """Answer a client."""
        self.clients.answered(caller, payload)

    def fail_call(self, face: Face, service: str, caller: bytes, reason: str, message: str) -> None:
        """Inform a client that no server answered."""
        self.clients.failed(caller, reason)


class RobotRelayShell(RelayShell):
    """The robot's relay. `journal`: its memory file, which outlives the process. `memory`: reads the collector's."""

    process: RobotRelay

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell], plan: RelayPlan) -> None:
        super().__init__(around, host, peers, plan)
        self.journal: list[bytes] = []
        self.memory: Any = lambda: None

    def _seen_beyond(self) -> list[tuple[Face, str, str]]:
        return [(Face.PUBLIC, name, text) for _, name, text in self.beyond.servers.seen()]

    def make(self, incarnation: str) -> RobotRelay:
        """Return the relay, with the journal of the one before."""
        return RobotRelay(self.plan, self, incarnation, list(self.journal))

    def holder(self) -> Holding:
        """Read the collector's memory."""
        kept = self.memory()
        if kept is None:
            return Holding(Site.ROBOT, 0, Token("", 0, ""))
        charge, _, fell_back, stay = kept
        return Holding(Site.ROBOT if fell_back else charge.site, stay, charge.token)

    def keep(self, record: bytes) -> bool:
        """Append to the journal."""
        self.journal.append(record)
        return True

    def compact(self, records: Sequence[bytes]) -> bool:
        """Replace the journal."""
        self.journal = list(records)
        return True


class CloudRelayShell(RelayShell):
    """The cloud's relay."""

    process: CloudRelay

    def make(self, incarnation: str) -> CloudRelay:
        """Return the relay."""
        return CloudRelay(self.plan, self, incarnation)
