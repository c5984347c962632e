"""The action server outside the group on the robot, and the nodes of both sides that use it (handover, rule 11)."""

from __future__ import annotations

from dataclasses import dataclass, field

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import Face, GoalStatus
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.settings import NodeSpec
from robot_offload_sim.sides.relays import CloudRelayShell, RobotRelayShell
from robot_offload_sim.world.nodes import Node
from robot_offload_sim.world.scenario import Replica
from robot_offload_sim.world.servers import Execution, Servers, goal_words
from robot_offload_sim.world.violations import ViolationError
from robot_offload_sim.world.world import Host, World

LOOK_S = 0.05
SLACK_S = 1.0
NODE = "outside"


@dataclass
class UsedGoal:
    """A goal of a side's node. `accepted`: by its relay. `results`: every answer to its question for the result."""

    number: int
    site: Site
    action: str
    accepted: bool | None = None
    fed: int = 0
    results: list[GoalStatus] = field(default_factory=list)


class Outside:
    """The outside server and its clients; judges invariants 6a, 6e and 7a for their goals.

    Attributes:
        node, servers: outside the group.
        goals: of both sides, by number.
        holders: the holder when the robot's relay offered an attempt.
        strange: since when a goal runs that does not belong to the present stay's holder.
    """

    def __init__(
        self, world: World, host: Host, plan: RelayPlan, robot: RobotRelayShell, cloud: CloudRelayShell
    ) -> None:
        self.world = world
        self.actions = {spec.name: spec for spec in plan.used_actions}
        self.relays = {Site.ROBOT: robot, Site.CLOUD: cloud}
        self.robot = robot
        self.node = Node(world, host, NodeSpec(NODE, lifecycle=False), Replica(), lambda *_: None)
        self.servers = Servers(world, Site.ROBOT, {NODE: self.node}, dict.fromkeys(self.actions, NODE))
        self.servers.watch = self._began
        self.servers.feed = lambda action, payload: robot.post(
            "outside", robot._then, "feedback_arrived", Face.PUBLIC, action, payload
        )
        self.goals: dict[int, UsedGoal] = {}
        self.holders: dict[bytes, Holding] = {}
        self.stays: dict[bytes, int] = {}
        self.strange: dict[bytes, float] = {}
        self.callers: dict[bytes, UsedGoal] = {}
        self.count = 0

    def start(self) -> None:
        """Start the server and the watch."""
        self.node.start()
        self.servers.start()
        self.world.after(LOOK_S, self._look)

    # -- clients ------------------------------------------------------------------------------------------------------

    def _caller(self, goal: UsedGoal) -> bytes:
        self.count += 1
        caller = b"o" + self.count.to_bytes(23, "big")
        self.callers[caller] = goal
        return caller

    def send(self, site: Site, action: str) -> UsedGoal:
        """Have a node of a side send a goal and ask for its result once it is accepted."""
        self.count += 1
        goal = self.goals[self.count] = UsedGoal(self.count, site, action)
        self._post(goal, "goal_requested", goal_words(goal.number))
        return goal

    def cancel(self, goal: UsedGoal) -> None:
        """Cancel a goal, as its client."""
        self._post(goal, "cancel_requested", goal.number.to_bytes(16, "big"), 0)

    def _post(self, goal: UsedGoal, name: str, *words: object) -> None:
        relay = self.relays[goal.site]
        if relay.alive:
            relay.post("client", relay._then, name, Face.GROUP, goal.action, self._caller(goal), *words)

    def accepted(self, caller: bytes, accepted: bool) -> None:
        """Note that a goal was accepted or refused."""
        goal = self.callers[caller]
        goal.accepted = accepted
        if accepted:
            self._post(goal, "result_requested", goal.number.to_bytes(16, "big"))

    def result(self, caller: bytes, status: GoalStatus) -> None:
        """Note that a question for a result was answered."""
        goal = self.callers[caller]
        if not goal.results:
            goal.results.append(status)
        elif goal.results != [status]:
            raise ViolationError("6a", f"goal {goal.number} outside has two results", self.world.now)

    def fed(self, payload: bytes) -> None:
        """Note that feedback reached the client."""
        self.goals[int.from_bytes(payload[4:20], "big")].fed += 1

    # -- promises -----------------------------------------------------------------------------------------------------

    def offered(self, attempt: bytes | None) -> None:
        """Judge a call of the robot's relay: permitted to the holder at that time, or on arrival."""
        if attempt is not None:
            self.holders[attempt] = self.robot.holder()

    def _began(self, execution: Execution) -> None:
        goal, holding = self.goals[execution.number], self.holders[execution.attempt]
        self.stays[execution.attempt] = holding.stay
        if goal.site is not holding.site:
            raise ViolationError(
                "7a", f"goal {goal.number} outside is of the {goal.site.value}, a standby", self.world.now
            )

    def _look(self) -> None:
        """Judge rule 11: goals left running by an earlier stay are asked to end in time."""
        self.world.after(LOOK_S, self._look)
        stay = self.robot.holder().stay
        for attempt, execution in self.servers.executions.items():
            ends = execution.status.ended or execution.asked_s is not None
            if ends or self.stays.get(attempt) == stay or not (self.robot.running and self.node.running):
                self.strange.pop(attempt, None)
                continue
            since_s = max(self.strange.setdefault(attempt, self.world.now), self.robot.running_since_s)
            most_s = self.actions[execution.action].cancel_after_s + SLACK_S
            if self.world.now - since_s > most_s:
                text = f"goal {execution.number} outside runs on, its side does not hold any more"
                raise ViolationError("7a", text, self.world.now)
