"""Both relays of the core on a table: time stands still until it is moved, servers do what a test lets them do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_offload_core.fence.token import Site, Token, presence
from robot_offload_core.relay.cloud import CloudRelay
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalEntry, GoalStatus
from robot_offload_core.relay.goals.wire_ids import goal_id_of, with_goal_id
from robot_offload_core.relay.goals.words import decode
from robot_offload_core.relay.process import RelayPlan, RelayProcess
from robot_offload_core.relay.robot import RobotRelay
from robot_offload_core.words.declared import (
    Accept,
    ActionSpec,
    OnSwitch,
    ServiceMode,
    ServiceSpec,
    UsedAction,
    UsedService,
)
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.messages import Egress, Letters, RelayOrders, RelayStatus

ROBOT, CLOUD = "a1" * 16, "c1" * 16
FOLLOW, SPIN, WAIT = "/follow_path", "/spin", "/wait"
PLAN, COUNT, CLEAR, LAMP, LIFT = "/make_plan", "/count", "/clear", "/lamp", "/lift"
ALL = RelayPlan(
    services=(
        ServiceSpec(PLAN, "nav_msgs/srv/GetPlan", "controller"),
        ServiceSpec(COUNT, "std_srvs/srv/Trigger", "controller", ServiceMode.IDEMPOTENT),
        ServiceSpec(CLEAR, "std_srvs/srv/Trigger", "controller", ServiceMode.BOTH),
    ),
    actions=(
        ActionSpec(FOLLOW, "nav2_msgs/action/FollowPath", OnSwitch.RESEND, "controller", core=True),
        ActionSpec(SPIN, "nav2_msgs/action/Spin", OnSwitch.ABORT, "controller", core=True),
        ActionSpec(WAIT, "nav2_msgs/action/Wait", OnSwitch.HOLD, "controller", Accept.HOLDER, core=True),
    ),
    used_services=(UsedService(LAMP, "std_srvs/srv/SetBool", "controller"),),
    used_actions=(UsedAction(LIFT, "test_msgs/action/Fibonacci", "controller"),),
)


def token(epoch: int) -> Token:
    """Returns a token of the two control processes here."""
    return Token(ROBOT, epoch, CLOUD)


def goal_id(number: int) -> bytes:
    """Returns a client's goal id."""
    return number.to_bytes(16, "big")


def goal(number: int, words: bytes = b"goal") -> bytes:
    """Returns a SendGoal request."""
    return b"\0\1\0\0" + goal_id(number) + words


def result(status: GoalStatus, words: bytes = b"") -> bytes:
    """Returns a GetResult response."""
    return b"\0\1\0\0" + bytes([status]) + words


class Side:
    """The shell of one relay.

    Attributes:
        offered, cancelled, results_asked, calls: what servers got, in order. members: of pools, who got the calls.
        auto: a server here accepts each offer at once.
        accepted, cancels, results, feedback, answers, failures: what clients got.
    """

    def __init__(self, pair: Pair, site: Site) -> None:
        self.pair, self.site = pair, site
        self.relay: RelayProcess | None = None
        self.auto = True
        self.offered: list[bytes] = []
        self.payloads: dict[bytes, tuple[str, bytes]] = {}
        self.cancelled: list[bytes] = []
        self.results_asked: list[bytes] = []
        self.calls: list[tuple[Face, str, int, bytes]] = []
        self.members: list[str] = []
        self.accepted: list[tuple[bytes, bool]] = []
        self.cancels: list[tuple[CancelCode, tuple[GoalEntry, ...]]] = []
        self.results: list[tuple[bytes, GoalStatus, bytes]] = []
        self.feedback: list[bytes] = []
        self.shown: dict[str, tuple[GoalEntry, ...]] = {}
        self.answers: list[tuple[bytes, bytes]] = []
        self.failures: list[tuple[bytes, str]] = []
        self.statuses: list[RelayStatus] = []
        self.journal: list[bytes] = []
        self.room = True
        self.acts: list[tuple[Any, ...]] = []

    def now_s(self) -> float:
        return self.pair.now

    def wall_ns(self) -> int:
        return round(self.pair.now * 1e9)

    def holder(self) -> Holding:
        return self.pair.holding

    def keep(self, record: bytes) -> bool:
        if self.room:
            self.journal.append(record)
        return self.room

    def compact(self, records: Sequence[bytes]) -> bool:
        if self.room:
            self.journal = list(records)
        return self.room

    def send(self, to: str, message: object) -> bool:
        if isinstance(message, Letters):
            self.pair.wire.append((self.site.other, message))
        elif isinstance(message, RelayStatus) and to == "control":
            self.statuses.append(message)
        return True

    def warn(self, message: str) -> None:
        raise AssertionError(message)

    def offer(self, face: Face, action: str, payload: bytes) -> None:
        attempt = goal_id_of(payload)
        assert attempt is not None
        assert attempt not in self.offered, "an id is offered twice"
        self.offered.append(attempt)
        self.payloads[attempt] = (action, payload)
        if self.auto:
            self.acts.append(("offer_answered", face, action, attempt, True))

    def cancel(self, face: Face, action: str, goal_id: bytes) -> None:
        self.cancelled.append(goal_id)

    def ask_result(self, face: Face, action: str, goal_id: bytes) -> None:
        self.results_asked.append(goal_id)

    def call(self, face: Face, service: str, key: int, payload: bytes) -> None:
        self.calls.append((face, service, key, payload))

    def call_member(self, service: str, member: str, key: int, payload: bytes) -> None:
        self.calls.append((Face.GROUP, service, key, payload))
        self.members.append(member)

    def forget_call(self, key: int) -> None:
        pass

    def answer_goal(self, face: Face, action: str, caller: bytes, accepted: bool, stamp_ns: int) -> None:
        self.accepted.append((caller, accepted))

    def answer_cancel(
        self, face: Face, action: str, caller: bytes, code: CancelCode, goals: Sequence[GoalEntry]
    ) -> None:
        self.cancels.append((code, tuple(goals)))

    def answer_result(self, face: Face, action: str, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        self.results.append((caller, status, payload))

    def publish_feedback(self, face: Face, action: str, payload: bytes) -> None:
        self.feedback.append(payload)

    def publish_status(self, face: Face, action: str, goals: Sequence[GoalEntry]) -> None:
        self.shown[action] = tuple(goals)

    def answer_call(self, face: Face, service: str, caller: bytes, payload: bytes) -> None:
        self.answers.append((caller, payload))

    def fail_call(self, face: Face, service: str, caller: bytes, reason: str, message: str) -> None:
        self.failures.append((caller, reason))

    # -- what its servers do ------------------------------------------------------------------------------------------

    def end(
        self, index: int, status: GoalStatus = GoalStatus.SUCCEEDED, words: bytes = b"", face: Face = Face.GROUP
    ) -> None:
        """The server ends its attempt number `index`."""
        attempt = self.offered[index]
        action, _ = self.payloads[attempt]
        assert self.relay is not None
        self.relay.result_arrived(face, action, attempt, status, result(status, words))
        self.pair.settle()

    def feed(self, index: int, words: bytes = b"", face: Face = Face.GROUP) -> None:
        """The server publishes feedback."""
        attempt = self.offered[index]
        assert self.relay is not None
        self.relay.feedback_arrived(
            face, self.payloads[attempt][0], with_goal_id(bytes(20), attempt) + words
        )  # fmt: skip
        self.pair.settle()


class Pair:
    """Both relays, the wire between them, and what the controls say.

    Attributes:
        holding: what the collector's memory says. candidate: whom control prepares. present: `presence` is granted.
        lose: words to that side are lost. lose_letters: all but hellos.
    """

    def __init__(self, plan: RelayPlan = ALL) -> None:
        self.plan = plan
        self.now = 1000.0
        self.holding = Holding(Site.ROBOT, 0, token(1))
        self.candidate: tuple[Site, Token] | None = None
        self.granted: Token | None = None
        self.effects: Site | None = Site.ROBOT
        self.present = True
        self.able = (Site.ROBOT, Site.CLOUD)
        self.wire: list[tuple[Site, Letters]] = []
        self.lose: set[Site] = set()
        self.lose_letters: set[Site] = set()
        self.starts = 0
        self.robot, self.cloud = Side(self, Site.ROBOT), Side(self, Site.CLOUD)
        self.start_robot()
        self.start_cloud()
        self.run(0.3)

    @property
    def relay(self) -> RobotRelay:
        """Returns the robot's relay."""
        assert isinstance(self.robot.relay, RobotRelay)
        return self.robot.relay

    def _incarnation(self) -> str:
        self.starts += 1
        return f"{self.starts:032x}"

    def start_robot(self, *, journal: bool = True) -> None:
        """Starts the robot's relay, with the journal of its predecessor."""
        records = self.robot.journal if journal else []
        self.robot.relay = RobotRelay(self.plan, self.robot, self._incarnation(), records)
        self.see(self.robot)

    def start_cloud(self) -> None:
        """Starts the cloud's relay."""
        self.cloud.relay = CloudRelay(self.plan, self.cloud, self._incarnation())
        self.see(self.cloud)

    def see(self, side: Side, endpoints: str = "1") -> None:
        """All servers of a side are in the graph."""
        assert side.relay is not None
        names = [spec.name for spec in (*self.plan.services, *self.plan.actions)]
        seen = [(Face.GROUP, name, endpoints) for name in names if endpoints]
        if side is self.robot:
            seen += [(Face.PUBLIC, spec.name, endpoints) for spec in self.plan.used_actions if endpoints]
        side.relay.servers_seen(seen)
        self.settle()

    def say(self) -> None:
        """The controls renew their levels."""
        robot, cloud = self.robot.relay, self.cloud.relay
        assert robot is not None
        assert cloud is not None
        epoch = max(self.holding.token.epoch, self.candidate[1].epoch if self.candidate else 0)
        robot.handle(
            RelayOrders(ROBOT, CLOUD, epoch, self.candidate, self.able, ("controller",), self.effects, self.now)
        )  # fmt: skip
        present = presence(ROBOT, CLOUD) if self.present else None
        ends_s = [self.now + 0.25 if token else 0.0 for token in (self.granted, present)]
        egress = SetEgress(self.granted, ends_s[0], presence=present, presence_end_s=ends_s[1])
        cloud.handle(Egress(CLOUD, ROBOT, egress, (("controller", "active"), ("planner", "active"))))

    def settle(self) -> None:
        """Lets both relays and the wire do all that needs no time."""
        for _ in range(20):
            for side in (self.robot, self.cloud):
                while side.acts:
                    name, *words = side.acts.pop(0)
                    getattr(side.relay, name)(*words)
                if side.relay is not None and side.relay.due_s <= self.now:
                    side.relay.turn()
            wire, self.wire = self.wire, []
            for to, letters in wire:
                side = self.robot if to is Site.ROBOT else self.cloud
                lost = to in self.lose or (to in self.lose_letters and decode(letters.data).number > 0)
                if not lost and side.relay is not None:
                    side.relay.handle(letters)
            if not wire and not self.robot.acts and not self.cloud.acts:
                return

    def run(self, seconds: float) -> None:
        """Lets time pass."""
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            self.say()
            self.settle()

    # -- what happens -------------------------------------------------------------------------------------------------

    def prepare(self, site: Site, epoch: int) -> None:
        """Control prepares a side."""
        self.candidate = (site, token(epoch))
        if site is Site.CLOUD:
            self.granted = token(epoch)
        self.run(0.05)

    def change(self, site: Site, epoch: int, *, sudden: bool = False) -> None:
        """The collector changes over; control says so a little later."""
        self.holding = Holding(site, self.holding.stay + 1, token(epoch))
        if sudden:
            self.granted = None
        self.settle()
        self.candidate = None
        if site is Site.CLOUD:
            self.granted = token(epoch)
        elif not sudden:
            self.granted = None
        self.effects = site
        self.run(0.05)

    def in_cloud(self) -> None:
        """The cloud holds."""
        self.prepare(Site.CLOUD, 2)
        self.change(Site.CLOUD, 2)

    def goal(self, number: int, action: str = FOLLOW) -> bytes:
        """A client sends a goal and asks for its result; returns the caller's name for the result."""
        caller = b"send %d" % number
        self.relay.goal_requested(Face.PUBLIC, action, caller, goal(number))
        self.settle()
        wants = b"result %d" % number
        self.relay.result_requested(Face.PUBLIC, action, wants, goal_id(number))
        self.settle()
        return wants

    def ask_cancel(
        self, number: int, action: str = FOLLOW, stamp_ns: int = 0
    ) -> tuple[CancelCode, tuple[GoalEntry, ...]]:
        """A client asks to cancel."""
        self.relay.cancel_requested(Face.PUBLIC, action, b"cancel", goal_id(number), stamp_ns)
        self.settle()
        return self.robot.cancels[-1]

    def call(self, service: str, number: int, words: bytes = b"please") -> bytes:
        """A client calls a service."""
        caller = b"call %d" % number
        self.relay.called(Face.PUBLIC, service, caller, words)
        self.settle()
        return caller

    def result_of(self, caller: bytes) -> list[GoalStatus]:
        """Returns the results that a client got."""
        return [status for who, status, _ in self.robot.results if who == caller]
