"""Promises that only time can break, checked with every tick of the robot's control process (10 ms)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robot_offload_core.control.nodes.guardians import INHIBIT_PERIOD_S
from robot_offload_core.control.nodes.managed_nodes import READ_PERIOD_S
from robot_offload_core.control.robot import placement
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.link import policies
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import Mode
from robot_offload_sim.promises.promises import Promises, Rank
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.nodes import Message

HANDOVER_S = 0.0025
"""Longest delivery of a local datagram."""
BUSY_S = 0.11
"""Delay of a service call that meets a busy executor."""
TIMER_S = 0.025
SETTLED_S = 8.0
"""T of invariant 5: the longest retry wait of the guardian after a storm, and the transitions."""
RETURN_S = 4.0
"""Time within which the cloud is used again once nothing holds it back: proving, preparing, changing over."""

BEFORE_CONTROL: Rank = (-1, 0, 0)


@dataclass
class Lane:
    """What the consumer of one output has seen.

    Attributes:
        passed_s: true time of the latest message.
        rank: rank of its stay in charge.
        last: (producer, sequence) of the latest message of each side.
        life: life of the collector at which the latest message passed.
    """

    passed_s: float
    rank: Rank
    last: dict[Site, Message]
    life: int = 0


class Deadlines(Promises):
    """Checks over time the promises in the docstrings of its methods."""

    def __init__(self, run: System, quiet_s: Callable[[], float]) -> None:
        super().__init__(run, quiet_s)
        self.loss_s: float | None = None
        self.loss_epoch = 0
        self.since_loss: set[int] = set()
        self.losses_judged = 0
        self.slowest_loss_s = 0.0
        self.reaction_s = run.scenario.reaction_s
        self.lanes = [Lane(0.0, BEFORE_CONTROL, {}) for _ in run.scenario.outputs]
        self.rated = [(i, o.deadline_s) for i, o in enumerate(run.scenario.outputs) if o.rated and not o.while_]
        self.prompt = {i for i, deadline_s in self.rated if deadline_s <= self.settings.activation_deadline_s}
        self.slowest_s = max((deadline_s for i, deadline_s in self.rated if i not in self.prompt), default=0.0)
        self.charged_s = 0.0
        self.good_s = 0.0
        self.entered_s = 0.0
        self.left_s: tuple[float, Token | None] = (-1.0, None)
        self.held_until_s = 0.0
        self.alone_s = 0.0
        self.robot_since_s = 0.0

    def control_ticked(self) -> None:
        """Judge everything that only time can break."""
        control = self.run.robot.control
        if any(n.state is not State.ACTIVE for n in control.guardian.nodes if not n.spec.duplicated):
            self.alone_s = self.world.now
        # Repeated stops are not each excused anew: a row of stops counts once, and excuses a lease.
        running_s = min(control.running_since_s, control.row_s + self.settings.lease_s)
        self._check_detection(control.robot, running_s)
        self._check_stopped(control.robot, running_s)
        self._check_first_commands(control.robot)
        self.check_rival(control.robot)
        self.check_stated(running_s)
        if self.quiet_s() > SETTLED_S:
            self._check_order(control.robot)

    def _check_first_commands(self, robot: placement.Robot) -> None:
        """Invariant 3e: after a loss for which only the link is to blame all rated outputs of the robot flow in time.

        That is within the transitions of its nodes, one after the other, a period, and a reaction.
        """
        loss_s, scenario, now = self.loss_s, self.run.scenario, self.world.now
        if loss_s is None or placement.IN_CHARGE[robot.phase] is not Site.ROBOT or robot.epoch != self.loss_epoch:
            self.loss_s = None
            return
        limit_s = len(scenario.robot_nodes) * (scenario.transition_s + BUSY_S) + scenario.reaction_s + 2 * TIMER_S
        limit_s += self.settings.robot_period_s
        if self.prompt <= self.since_loss:
            self.losses_judged += 1
            self.slowest_loss_s = max(self.slowest_loss_s, now - loss_s)
            self.loss_s = None
        elif now - loss_s > limit_s:
            self.violated("3e", f"no command of the robot {(now - loss_s) * 1e3:.0f} ms after a loss of the link")

    def _check_detection(self, robot: placement.Robot, running_s: float) -> None:
        """Invariant 3a: control, while it runs, ends a stay in the cloud a loss timeout after the last good beat.

        One tick and two hand-overs later at most. However often control is stopped: no stay lasts a lease and a loss
        timeout longer than good beats come, as seen at its turns.
        """
        if placement.IN_CHARGE[robot.phase] is not Site.CLOUD:
            return
        stalled_s = self.world.now - max(self.good_s, self.entered_s)
        if stalled_s > self.settings.lease_s + self.run.scenario.tick_s + self.settings.loss_timeout_s:
            self.violated("3a", f"the cloud is in charge {stalled_s * 1e3:.0f} ms after the last good beat")
        silent_s = self.world.now - max(self.good_s, self.entered_s, running_s)
        if silent_s > self.settings.loss_timeout_s + self.run.scenario.tick_s + 2 * HANDOVER_S:
            self.violated("3a", f"the cloud is still in charge {silent_s * 1e3:.0f} ms after the last good beat")

    def _check_released(self) -> None:
        """Invariant 3d: the robot's sleeping or waking replicas do not stop the wheels while the cloud is in charge."""
        control, driver = self.run.robot.control, self.run.driver
        base_s = max(self.entered_s, self.alone_s, control.running_since_s, driver.running_since_s) + INHIBIT_PERIOD_S
        if self.world.now > base_s + 0.1:
            self.violated("3d", "the driver is inhibited although the cloud is in charge")

    def _check_stopped(self, robot: placement.Robot, running_s: float) -> None:
        """Invariant 3b: rated outputs flow or the driver is inhibited.

        While control runs no rated output is silent for longer than (its deadline or the loss timeout, whichever is
        longer) + activation deadline + reaction, unless the wheels are inhibited: that they stand by their dead man
        is no excuse. A collector that gets its processor in slices sees the silence two slices later at most: the one
        in which it fell due, and the one in which its grace after that pause ends. Control in slices decides one of its
        own later. A driver that restarted counts from then, plus the period in which a standing inhibit is repeated; a
        driver that was released may wait for the next message of the slower side. An output that is slower than nodes
        wake has its deadline from the changeover on, and from the return of its node. Stopped or dead, control can
        inhibit nobody: there the driver's dead man is the stop.
        """
        driver, now = self.run.driver, self.world.now
        if not driver.alive:  # it stands, and cannot be released
            return
        if driver.inhibited and placement.IN_CHARGE[robot.phase] is Site.CLOUD and not self.stands_for_rival():
            self._check_released()
        if driver.inhibited:
            return
        collector = self.run.robot.collector
        resumed_s = collector.state.resumed_s  # a collector that restarts counts silence from then, once
        resumed_s = -1.0 if resumed_s is None else now - (collector.host.now_s() - resumed_s)
        base_s = max(running_s, driver.running_since_s + INHIBIT_PERIOD_S, resumed_s)
        slices_s = 2 * min(collector.stood_s, self.settings.lease_s) if collector.starved() else 0.0
        if self.run.robot.control.starved():
            slices_s += min(self.run.robot.control.stood_s, self.settings.lease_s)
        for index, deadline_s in self.rated:
            since_s = max(base_s, self.lanes[index].passed_s)
            if index not in self.prompt:  # publishes one of its periods after its side took over
                since_s = max(since_s, self.charged_s, self._returned_s(index))
            silent_s = now - since_s
            limit_s = (
                max(deadline_s, self.settings.loss_timeout_s)
                + self.settings.activation_deadline_s
                + 2 * self.reaction_s
                + driver.slow_s
                + slices_s
            )
            if silent_s > limit_s and now - driver.released_s > self.settings.slower_period_s + self.reaction_s:
                self.violated("3b", f"output {index} is silent for {silent_s * 1e3:.0f} ms, the driver not inhibited")

    def _returned_s(self, index: int) -> float:
        """Return when the robot's node of an output was awake again, seen by a read: a transition may take long."""
        node = self.run.robot.nodes.get(self.run.scenario.publishers[index])
        return -1.0 if node is None else max(node.running_since_s, node.active_s) + READ_PERIOD_S

    def _check_order(self, robot: placement.Robot) -> None:
        """Invariant 5: with nothing wrong for 8 s exactly one side acts, and the cloud is used again.

        Every rated output flows, the driver is released, nothing leaves the cloud while the robot has been in charge
        for a lease and two beats. When the policy wants the cloud, no retry, no hold-down and no goal that must not be
        interrupted has been pending for 4 s, and what the link has taught does not speak against it (the tests of the
        core say for how long that may be), it is in the cloud (liveness, beyond the letter of the protocol).
        """
        now, settings = self.world.now, self.settings
        for index, deadline_s in self.rated:
            silent_s = now - self.lanes[index].passed_s
            if index not in self.prompt:
                silent_s = now - max(self.lanes[index].passed_s, self.charged_s)
            if silent_s > deadline_s + self.reaction_s:
                self.violated("5", f"long after the last fault output {index} is silent for {silent_s * 1e3:.0f} ms")
        if self.run.driver.inhibited and not self.stands_for_rival():
            self.violated("5", "long after the last fault the driver is still inhibited")
        left_s, token = self.left_s
        phase_s = now - self.robot_since_s
        if robot.phase is Phase.ROBOT and phase_s > settings.lease_s + 0.1 and left_s > now - 0.02:
            self.violated("5", f"the robot acts, and messages leave the cloud under epoch {token and token.epoch}")
        host_now_s = self.run.robot.host.now_s()
        asked = robot.settings
        wants = asked.prefer is Site.CLOUD and asked.pin is not Site.ROBOT and asked.mode is Mode.AUTO
        by_hand = robot.manual is not None and robot.manual.holds(host_now_s)
        pinned = robot.pin is not None and robot.pin.holds(host_now_s)
        held = by_hand or pinned or host_now_s < max(robot.retry_s, robot.policy.hold_until_s)
        held = held or policies.waits(robot.policy) or self.rivalled()
        leaving = robot.leaving
        held = held or (leaving is not None and leaving.cloud == robot.link.peer and host_now_s < leaving.until_s)
        handing = robot.handing
        if handing.held_s is not None and handing.report is not None and handing.report.hold:
            held = held or host_now_s - handing.held_s < handing.report.hold_for_s
        held = held or any(n.spec.core and not n.alive for n in self.run.cloud.nodes.values())
        if held or not wants or placement.IN_CHARGE[robot.phase] is Site.CLOUD:
            self.held_until_s = now
        elif now - max(self.held_until_s, now - self.quiet_s() + SETTLED_S) > RETURN_S + 2 * self.slowest_s:
            self.violated("5", f"nothing is wrong and the cloud is not used: {robot.decided.reason}")
