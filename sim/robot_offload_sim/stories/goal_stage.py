"""A stage with relays: a navigation stack of one node, its actions and services, and clients."""

from __future__ import annotations

from typing import Any

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import (
    Accept,
    ActionSpec,
    OnSwitch,
    ServiceMode,
    ServiceSpec,
    UsedAction,
    UsedService,
)
from robot_offload_core.words.settings import OutputSpec, Settings
from robot_offload_sim.sides.clients import ClientCall, ClientGoal
from robot_offload_sim.sides.handing import Handing
from robot_offload_sim.stories.stage import Stage
from robot_offload_sim.world.servers import Execution, Traits

FOLLOW, SPIN, DOCK = "/follow_path", "/spin", "/dock"
PLAN, COUNT, CLEAR, LAMP, LIFT = "/make_plan", "/count", "/clear", "/lamp", "/lift"
RELAY = RelayPlan(
    services=(
        ServiceSpec(PLAN, "nav_msgs/srv/GetPlan", "controller", core=True),
        ServiceSpec(COUNT, "std_srvs/srv/Trigger", "controller", ServiceMode.IDEMPOTENT, core=True),
        ServiceSpec(CLEAR, "std_srvs/srv/Trigger", "controller", ServiceMode.BOTH, core=True),
    ),
    actions=(
        ActionSpec(FOLLOW, "nav2_msgs/action/FollowPath", OnSwitch.RESEND, "controller", core=True),
        ActionSpec(SPIN, "nav2_msgs/action/Spin", OnSwitch.ABORT, "controller", core=True),
        ActionSpec(DOCK, "nav2_msgs/action/Dock", OnSwitch.HOLD, "controller", Accept.HOLDER, 3.0, core=True),
    ),
    used_services=(UsedService(LAMP, "std_srvs/srv/SetBool", "controller"),),
    used_actions=(UsedAction(LIFT, "test_msgs/action/Fibonacci", "controller"),),
)
SETTINGS = Settings(hold_down_initial_s=1.0, flap_window_s=3.0, hold_down_max_s=4.0, prepare_deadline_s=5.0)


class GoalStage(Stage):
    """A stage with relays, servers and clients. Output 0 is not rated: it is silent when there is nothing to do."""

    def __init__(self, name: str = "story", **changes: Any) -> None:
        changes.setdefault("relay", RELAY)
        changes.setdefault("settings", SETTINGS)
        changes.setdefault("outputs", (OutputSpec("cmd_vel", 0.15),))
        super().__init__(name, **changes)
        assert self.system.handing is not None
        self.handing: Handing = self.system.handing
        self.clients = self.handing.clients

    def traits(self, side: Site, name: str = FOLLOW) -> Traits:
        """Return how a server behaves."""
        return self.handing.servers[side].traits[name]

    def copies(self, side: Site, goal: ClientGoal) -> list[Execution]:
        """Return what a side executes of a goal now."""
        return self.handing.servers[side].running(goal.number)

    def began(self, side: Site, goal: ClientGoal) -> int:
        """Return how often a side has begun a goal."""
        return sum(1 for e in self.handing.servers[side].began if e.number == goal.number)

    def goal(self, action: str = FOLLOW) -> ClientGoal:
        """Have a client send a goal, which begins on the side in charge."""
        goal = self.clients.send(action)
        self.until(lambda: bool(goal.accepted), 3.0, "the goal is accepted")
        self.until(lambda: bool(self.copies(self.holder, goal)), 3.0, "the goal is executed")
        return goal

    def on_robot(self) -> None:
        """Start, and wait until all is calm with a pin on the robot."""
        self.start()
        self.robot_acts()
        self.pin(Site.ROBOT)
        self.run(2.0)

    @property
    def holder(self) -> Site:
        """Return the holder according to the collector's memory."""
        return self.handing.robot.holder().site

    def to(self, site: Site, within_s: float = 8.0) -> None:
        """Switch by hand."""
        self.expect(self.by_hand(site), "the switch is accepted")
        self.until(lambda: self.holder is site, within_s, f"the {site.value} holds")

    def lose_cloud(self) -> Any:
        """Cut the link; return the function that restores it."""
        join = self.cut()
        self.until(lambda: self.holder is Site.ROBOT, 2.0, "the robot takes over")
        return join

    def ends(self, goal: ClientGoal, status: GoalStatus, within_s: float = 5.0) -> None:
        """Wait until the client has its result."""
        self.until(lambda: bool(goal.results), within_s, f"goal {goal.number} has a result")
        self.expect(goal.results[0][0] is status, f"goal {goal.number} is {goal.results[0][0].name}, not {status.name}")

    def let_end(self, action: str = FOLLOW) -> None:
        """Let executions on both sides end."""
        for site in Site:
            self.traits(site, action).takes_s = 0.0

    def answered(self, call: ClientCall, within_s: float = 3.0) -> None:  # type: ignore[override]
        """Wait until a caller has its answer."""
        self.until(lambda: bool(call.answers), within_s, f"call {call.number} is answered")
