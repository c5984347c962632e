"""Clients on the robot: standard action and service clients, and the promises to them (handover, section 9)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalEntry, GoalStatus
from robot_offload_core.relay.goals.wire_ids import NO_GOAL
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import ServiceMode
from robot_offload_core.words.holding import Holding
from robot_offload_sim.sides.relays import RelayShell, RobotRelayShell
from robot_offload_sim.world.servers import Execution, Servers, goal_words
from robot_offload_sim.world.violations import ViolationError
from robot_offload_sim.world.world import World

LOOK_S = 0.05
ASK_AGAIN_S = 3.0
"""A client whose request for a result was lost with a relay asks again, like one that polls."""
SLACK_S = 1.0
"""Added to each deadline below, for hand-overs, letters sent again and a restarted relay."""


@dataclass
class ClientGoal:
    """What a client knows of its goal. Times are true ones.

    Attributes:
        results: (status, payload) of each terminal answer.
        cancel: whether a cancel of it was accepted.
        bare_s: since when no copy of it has been running at the holder.
        fed: (stay, site, tick, attempt) of the feedback that passed.
    """

    number: int
    action: str
    sent_s: float
    accepted: bool | None = None
    stamp_ns: int = 0
    results: list[tuple[GoalStatus, bytes]] = field(default_factory=list)
    cancel: bool = False
    bare_s: float | None = None
    fed: list[tuple[int, Site, int, bytes]] = field(default_factory=list)

    @property
    def open(self) -> bool:
        """Return whether it was accepted and has no result."""
        return bool(self.accepted) and not self.results


@dataclass
class ClientCall:
    """A call: where it was executed, and what its caller received."""

    number: int
    service: str
    sent_s: float
    executed: list[tuple[Site, int, float]] = field(default_factory=list)
    answers: list[bytes] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


class Clients:
    """All clients, and the observer of the promises to them: invariants 6a to 6e, 7a and 9.

    Attributes:
        goals, calls: by number.
        unnamed: since when a copy runs whose end was not requested.
        used: effects at services outside, (site, service, true time).
        count: counter for the numbers of goals, calls and callers.
    """

    def __init__(
        self, world: World, plan: RelayPlan, relay: RobotRelayShell, others: RelayShell, servers: dict[Site, Servers]
    ) -> None:
        self.world = world
        self.plan = plan
        self.relay = relay
        self.cloud_relay = others
        self.servers = servers
        self.goals: dict[int, ClientGoal] = {}
        self.calls: dict[int, ClientCall] = {}
        self.callers: dict[bytes, tuple[str, int]] = {}
        self.used: list[tuple[Site, str, float]] = []
        self.count = 0
        self.actions = {spec.name: spec for spec in plan.actions}
        self.services = {spec.name: spec for spec in plan.services}
        self.stay_s = 0.0
        self.holding = Holding(Site.ROBOT, 0, relay.holder().token)
        self.lease_s = plan.lease_s
        for site, server in servers.items():
            server.heard_call = partial(self._executed, site)
        relay.outside = self._effect
        self.unnamed: dict[tuple[Site, bytes], float] = {}

    def start(self) -> None:
        """Begin to check the promises."""
        self.world.after(LOOK_S, self._look)

    # -- what clients do ----------------------------------------------------------------------------------------------

    def _caller(self, kind: str, number: int) -> bytes:
        self.count += 1
        caller = self.count.to_bytes(24, "big")
        self.callers[caller] = (kind, number)
        return caller

    def send(self, action: str) -> ClientGoal:
        """Send a goal."""
        self.count += 1
        goal = self.goals[self.count] = ClientGoal(self.count, action, self.world.now)
        caller = self._caller("goal", goal.number)
        self._to_relay("goal_requested", action, caller, goal_words(goal.number))
        return goal

    def ask(self, goal: ClientGoal) -> None:
        """Ask for the result."""
        caller = self._caller("result", goal.number)
        self._to_relay("result_requested", goal.action, caller, goal.number.to_bytes(16, "big"))

    def cancel(self, action: str, goal: ClientGoal | None = None, stamp_ns: int = 0) -> None:
        """Ask to cancel a goal, those up to a time, or all."""
        goal_id = NO_GOAL if goal is None else goal.number.to_bytes(16, "big")
        caller = self._caller("cancel", goal.number if goal is not None else 0)
        self._to_relay("cancel_requested", action, caller, goal_id, stamp_ns)

    def call(self, service: str) -> ClientCall:
        """Call a served service."""
        self.count += 1
        call = self.calls[self.count] = ClientCall(self.count, service, self.world.now)
        self._to_relay("called", service, self._caller("call", call.number), call.number.to_bytes(8, "big"))
        return call

    def use(self, site: Site, service: str) -> ClientCall:
        """Have a replica of a side call a service outside the group."""
        self.count += 1
        call = self.calls[self.count] = ClientCall(self.count, service, self.world.now)
        relay = self.relay if site is Site.ROBOT else self.cloud_relay
        caller, words = self._caller("call", call.number), (b"r" if site is Site.ROBOT else b"c")
        relay.post("client", relay._then, "called", Face.GROUP, service, caller, words + call.number.to_bytes(8, "big"))
        return call

    def _to_relay(self, name: str, *words: Any) -> None:
        if self.relay.alive:
            self.relay.post("client", self.relay._then, name, Face.PUBLIC, *words)

    # -- what they hear -----------------------------------------------------------------------------------------------

    def accepted(self, caller: bytes, accepted: bool, stamp_ns: int) -> None:
        """Note that a goal was accepted or refused."""
        goal = self._goal(caller)
        if goal is None:
            return
        self.expect(goal.accepted is None, "6a", f"goal {goal.number} was answered twice")
        goal.accepted, goal.stamp_ns = accepted, stamp_ns
        if accepted:
            goal.bare_s = self.world.now
            self.ask(goal)
            self.world.after(ASK_AGAIN_S, self._ask_again, goal)

    def _ask_again(self, goal: ClientGoal) -> None:
        if goal.open:
            self.ask(goal)
            self.world.after(ASK_AGAIN_S, self._ask_again, goal)

    def cancelled(self, caller: bytes, code: CancelCode, entries: tuple[GoalEntry, ...]) -> None:
        """Note that a cancel was answered."""
        for entry in entries if code is CancelCode.NONE else ():
            self.goals[int.from_bytes(entry.goal_id, "big")].cancel = True

    def result(self, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        """Note that a question for a result was answered."""
        goal = self._goal(caller)
        if goal is None:
            return
        self.world.note("client: goal", goal.number, "has", status.name)
        self.expect(status.ended, "6a", f"goal {goal.number} was accepted and is unknown")
        self.expect(
            not goal.results or goal.results[0] == (status, payload), "6a", f"goal {goal.number} has two results"
        )
        self.expect(goal.cancel or status is not GoalStatus.CANCELED, "6e", f"goal {goal.number}: nobody cancelled")
        if payload and payload[5:6] in (b"r", b"c") and not goal.results:
            self._judge_result(goal, Site.ROBOT if payload[5:6] == b"r" else Site.CLOUD, status)
        goal.results.append((status, payload))

    def _judge_result(self, goal: ClientGoal, site: Site, status: GoalStatus) -> None:
        """Judge that a standby's result reaches no client, but for a success of the side that held before."""
        holds = site is self._now().site
        before = site is self.holding.site or self.world.now - self.stay_s < SLACK_S
        earlier = status is GoalStatus.SUCCEEDED and site is Site.CLOUD
        self.expect(holds or before or earlier, "9", f"goal {goal.number}: the {site.value}'s end, it does not hold")

    def fed(self, payload: bytes) -> None:
        """Note that feedback passed."""
        goal = self.goals[int.from_bytes(payload[4:20], "big")]
        self.expect(int.from_bytes(payload[20:28], "big") == goal.number, "6b", f"goal {goal.number}: of another goal")
        site = Site.ROBOT if payload[28:29] == b"r" else Site.CLOUD
        holding = self._now()
        self.expect(site is holding.site, "6b", f"goal {goal.number}: feedback of the {site.value}, a standby")
        passed = (holding.stay, site, int.from_bytes(payload[29:33], "big"), payload[33:49])
        if goal.fed and goal.fed[-1][0] == passed[0] and goal.results == []:
            _, _, tick, attempt = goal.fed[-1]
            # Another copy of the same stay: its server had forgotten the goal, or ended it. No earlier copy returns.
            forward = tick < passed[2] if attempt == passed[3] else all(heard[3] != passed[3] for heard in goal.fed)
            self.expect(forward, "6b", f"goal {goal.number}: feedback went back")
        self.expect(not goal.fed or passed[0] >= goal.fed[-1][0], "6b", f"goal {goal.number}: feedback of a past stay")
        goal.fed.append(passed)

    def answered(self, caller: bytes, payload: bytes) -> None:
        """Note that a call was answered."""
        call = self.calls[self.callers[caller][1]]
        self.expect(not call.answers and not call.failures, "7a", f"call {call.number} was answered twice")
        call.answers.append(payload)

    def failed(self, caller: bytes, reason: str) -> None:
        """Note that a call got no server's answer."""
        call = self.calls[self.callers[caller][1]]
        self.expect(not call.answers, "7a", f"call {call.number} was answered twice")
        call.failures.append(reason)

    def _goal(self, caller: bytes) -> ClientGoal | None:
        return self.goals.get(self.callers[caller][1])

    # -- what happens at servers --------------------------------------------------------------------------------------

    def _executed(self, site: Site, service: str, payload: bytes) -> None:
        call = self.calls[int.from_bytes(payload[:8], "big")]
        call.executed.append((site, self._now().stay, self.world.now))
        mode = self.services[service].mode
        here = [stay for at, stay, _ in call.executed if at is site]
        if mode is ServiceMode.HOLDER:
            self.expect(len(call.executed) == 1, "7a", f"call {call.number} was executed twice")
        elif mode is ServiceMode.IDEMPOTENT:
            self.expect(len(here) == len(set(here)), "7a", f"call {call.number} was executed twice in one stay")

    def _effect(self, service: str, payload: bytes) -> None:
        site = Site.ROBOT if payload[:1] == b"r" else Site.CLOUD
        self.used.append((site, service, self.world.now))
        self.expect(site is self._now().site, "7a", f"{service} was called by the {site.value}, a standby")

    # -- promises over time -------------------------------------------------------------------------------------------

    def _now(self) -> Holding:
        return self.relay.holder()

    def _look(self) -> None:
        self.world.after(LOOK_S, self._look)
        holding = self._now()
        if (holding.site, holding.stay) != (self.holding.site, self.holding.stay):
            self.holding, self.stay_s = holding, self.world.now
        for goal in self.goals.values():
            if goal.open:
                self._look_at(goal)
        for site, servers in self.servers.items():
            for execution in list(servers.executions.values()):
                self._look_at_copy(site, execution)

    def _look_at(self, goal: ClientGoal) -> None:
        """Judge 6c: a copy at the holder, or an offer that is not too old. A relay that is down stops the time."""
        spec = self.actions[goal.action]
        held = bool(self.servers[self.holding.site].running(goal.number))
        down = not self.relay.running or self.world.now - self.relay.running_since_s < SLACK_S
        if held or down or self.world.now - self.stay_s < LOOK_S:
            goal.bare_s = self.world.now
            return
        bare_s = self.world.now - (goal.bare_s or goal.sent_s)
        most_s = self.plan.prepare_deadline_s + spec.timeout_s + SLACK_S
        self.expect(bare_s <= most_s, "6c", f"goal {goal.number} is executed by nobody for {bare_s:.2f} s")

    def _look_at_copy(self, site: Site, execution: Execution) -> None:
        """Judge 6d: an unnamed execution at the other side is asked to end within lease + 1 s."""
        relay = self.relay if site is Site.ROBOT else self.cloud_relay
        node = self.servers[site].nodes[self.servers[site].of[execution.action]]
        orders = self.relay.process.orders
        candidate = orders is not None and orders.candidate is not None and orders.candidate[0] is site
        spec = self.actions[execution.action]
        named = spec.of_cloud or (spec.mirror and site in spec.hot)
        ends = execution.status.ended or execution.asked_s is not None or named
        key = site, execution.attempt
        if ends or site is self.holding.site or candidate or not (relay.running and node.running):
            self.unnamed.pop(key, None)
            return
        since_s = max(self.unnamed.setdefault(key, self.world.now), relay.running_since_s, node.running_since_s)
        self.expect(
            self.world.now - since_s <= self.lease_s + 1.0 + SLACK_S,
            "6d",
            f"goal {execution.number} runs on at the {site.value}, nobody has asked it to end",
        )

    def finish(self, quiet_s: float) -> None:
        """Judge 6a: a goal accepted long ago that could end has a result; callers have an answer.

        Each changeover restarts an execution (Resend), so one that has just begun may take its time.
        """
        for goal in self.goals.values():
            ends = self.servers[Site.ROBOT].traits[goal.action].takes_s < quiet_s
            executions = (e for servers in self.servers.values() for e in servers.executions.values())
            began_s = max((e.began_s for e in executions if e.number == goal.number), default=goal.sent_s)
            old = self.world.now - max(goal.sent_s, began_s) > quiet_s
            self.expect(not (goal.open and old and ends), "6a", f"goal {goal.number} never got a result")
        for call in self.calls.values():
            old = self.world.now - call.sent_s > quiet_s
            lost = not (call.answers or call.failures or call.executed == [])
            self.expect(not (old and lost), "7a", f"call {call.number} was executed and never answered")

    def expect(self, holds: bool, invariant: str, text: str) -> None:
        """Raise ViolationError unless a promise holds."""
        if not holds:
            raise ViolationError(invariant, text, self.world.now)

    def resends(self, action: str) -> bool:
        """Return whether goals of an action may be executed twice."""
        return self.actions[action].on_switch.resends
