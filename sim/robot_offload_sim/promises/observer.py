"""The invariants of the protocol, checked from outside the machines in true time.

The observer sees the consumer (what passes), the cloud's egress (what leaves), the wire (which grants were sent and
received), the wheels, and the admission of effects. It knows the producer and sequence of every message. Invariants
that an event can break are checked at that event; those that only time can break are in `deadlines`. The docstring of a
method is the definition that is checked.
"""

from __future__ import annotations

from collections.abc import Callable

from robot_offload_core.control.robot import placement
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token, presence
from robot_offload_core.words.beats import Beat, CloudReport, Permission, unveil
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.gates import Gate
from robot_offload_sim.promises.deadlines import BEFORE_CONTROL, HANDOVER_S, Deadlines, Lane
from robot_offload_sim.promises.promises import OTHERS, Rank
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.known import Known
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload, decoded

DRIFT = 4.1e-4
"""Two clocks of up to 200 ppm each."""


def _tokens(permission: Permission, robot: str) -> list[Token]:
    """Return the tokens that a permission of a robot's control grants."""
    found = [permission.token(robot)] if permission.granted else []
    return [*found, presence(robot, permission.cloud)] if permission.presence or permission.granted else found


class Observer(Deadlines):
    """Watches one stretch.

    Attributes:
        changeovers: how often the side in charge changed, by "commanded" and "sudden".
        passed_messages: per side.
        alarms: sudden losses by reason.
    """

    def __init__(self, run: System, quiet_s: Callable[[], float], *, only_link: bool = False) -> None:
        super().__init__(run, quiet_s)
        self.only_link = only_link
        self.mirrored = frozenset(run.scenario.mirrored)
        self.rank: Rank = BEFORE_CONTROL
        self.named_s: dict[Token, float] = {}
        self.permitted_s: dict[Token, float] = {}
        self.heard_grant_s: dict[Token, float] = {}
        self.handed = Known(HANDOVER_S)
        # Control learns of the pulse's last beat only with the next arriving beat: it may not know the newest one yet.
        self.sent = Known(HANDOVER_S + self.settings.beat_period_s)
        self.flip_s: float | None = None
        self.left_stay: tuple[int, int] | None = None
        self.effect_rank: tuple[int, int] = (-1, 0)
        self.effect_site: Site | None = None
        self.changeovers = {"commanded": 0, "sudden": 0}
        self.passed_messages = {Site.ROBOT: 0, Site.CLOUD: 0}
        self.alarms: dict[str, int] = {}
        self.input_age_s = {spec.name: spec.max_age_s for spec in run.scenario.input_specs}

    # -- who is who ---------------------------------------------------------------------------------------------------

    def robot_started(self, incarnation: str) -> None:
        """Note that the robot's control process has started: its tokens outrank those of all earlier lives."""
        self.order[incarnation] = len(self.order)
        self.world.note("robot control started", incarnation[:6])

    def cloud_started(self, incarnation: str) -> None:
        """Note that the cloud's control process has started."""
        self.world.note("cloud control started", incarnation[:6])

    def gate_said(self, gate: Gate) -> None:
        """Note which side control has ordered the collector to pass."""
        self.named_s[gate.current.token] = self.world.now
        if gate.next is not None:
            self.named_s[gate.next.token] = self.world.now
        if gate.presence is not None:
            self.named_s[gate.presence] = self.world.now

    def robot_decided(self, decided: Decided) -> None:
        """Take a decision of control. Count changeovers; invariant 3c: no false alarm.

        3c: no loss is decided for silence of the link while a good beat reached the pulse process within the loss
        timeout (less a hand-over), and none for silence of the pulse process while it sends: a stall of control itself
        is nobody's silence.
        """
        self.world.note(
            "robot", decided.phase.value, decided.epoch, decided.verdict.reason.value, decided.verdict.message
        )
        if decided.phase in (Phase.ROBOT, Phase.TAKEOVER):
            self.robot_since_s = self.world.now
        self.run.around.entered("robot " + decided.phase.value)
        if not decided.switched:
            return
        self.charged_s = self.world.now
        self.check_reason(decided)
        if decided.site is Site.CLOUD:
            self.entered_s = self.world.now
        sudden = self.flip_s is None or self.world.now - self.flip_s > 0.05
        if decided.site is Site.CLOUD or not sudden:
            self.changeovers["commanded"] += 1
            return
        self.changeovers["sudden"] += 1
        if self.only_link:
            self.loss_s, self.loss_epoch, self.since_loss = self.world.now, decided.epoch, set()
        reason = decided.verdict.reason.value
        self.alarms[reason] = self.alarms.get(reason, 0) + 1
        known = {"HeartbeatLost": self.handed, "PulseSilent": self.sent}.get(reason)
        if known is None:
            return
        ago_s = self.world.now - known.newest_s(self.world.now)
        if ago_s < self.strictest_loss_s - known.late_s:
            self.violated("3c", f"{reason} was decided although there was a beat {ago_s * 1e3:.1f} ms ago")

    # -- what passes --------------------------------------------------------------------------------------------------

    def passed(self, index: int, payload: Payload) -> None:
        """Invariant 1, at the consumer of a collected output.

        1a: the rank of its stay in charge (start of control, epoch, fallback) never decreases, over all outputs.
        1b: per output and side (start of the producer, sequence) strictly increases, for ever; the newest message of a
        latched output may pass once more in a new stay, because consumers have heard the other side's since, and at a
        collector that was started again, because its publisher has nothing for late consumers.
        1c: a message of the cloud carries a token that control named to the collector at most a lease ago.
        1d: a message of the cloud was published there at most `max_command_age_s` ago, unless it is latched.
        """
        if payload.message.producer == OTHERS:
            self.violated("9", f"what others said on output {index} passed as the group's")
        if self.run.scenario.outputs[index].of_cloud:
            self._passed_result(index, payload)
            return
        now = self.world.now
        site, message, left_s = payload.site, payload.message, payload.left_s
        envelope = decoded(payload.header) if payload.header else None
        rank = self._rank_of(envelope)
        if rank < self.rank:
            self.violated("1a", f"a {site.value} message of stay {rank} passed after stay {self.rank}")
        lane = self.lanes[index]
        last = lane.last.get(site)
        life = self.run.robot.collector.life
        new = rank != lane.rank or life != lane.life
        again = message == last and new and self.run.scenario.outputs[index].latched
        if last is not None and not again and (message.life, message.sequence) <= (last.life, last.sequence):
            self.violated("1b", f"{message.producer} {message.sequence} passed after {last.sequence}")
        if envelope is not None:
            self._check_cloud_message(envelope, now - left_s)
        if rank != lane.rank:
            self._entered(lane, index, now)
        elif last is not None and message.sequence != last.sequence + 1 and message.life == last.life:
            self._check_lost(lane, last, message)
        if site is Site.ROBOT:
            self.since_loss.add(index)
            if index in self.mirrored:
                self.passed_under[message] = rank[:2]
        lane.last[site], lane.life = message, life
        lane.passed_s, lane.rank, self.rank = now, rank, rank
        self.passed_messages[site] += 1

    def _passed_result(self, index: int, payload: Payload) -> None:
        """Invariant 1e: results of nodes with placement Cloud pass whoever is in charge, young and in order.

        Under the token of presence of the robot's present control and of a cloud that it addressed at most a lease ago,
        no older than their `maxAge`, and never one before another.
        """
        envelope, message, lane = decoded(payload.header), payload.message, self.lanes[index]
        spec = self.run.scenario.outputs[index]
        limit_s = (spec.max_age_s or self.settings.max_command_age_s) * (1 + DRIFT) + HANDOVER_S
        age_s = self.world.now - payload.left_s
        if age_s > limit_s:
            self.violated("1e", f"a result passed {age_s * 1e3:.1f} ms after it had been published in the cloud")
        named_s = self.named_s.get(envelope.token, -1e9)
        if self.world.now - named_s > self.settings.lease_s * (1 + DRIFT) + HANDOVER_S:
            self.violated("1e", "a result passed under a token that control does not name (any more)")
        last = lane.last.get(Site.CLOUD)
        if last is not None and (message.life, message.sequence) <= (last.life, last.sequence):
            self.violated("1e", f"{message.producer} {message.sequence} passed after {last.sequence}")
        lane.last[Site.CLOUD], lane.passed_s = message, self.world.now
        self.result_s[index] = self.world.now

    def _rank_of(self, envelope: Envelope | None) -> Rank:
        if envelope is not None:
            return (self.order.get(envelope.token.robot, -2), envelope.token.epoch, 0)
        state = self.run.robot.collector.state
        if state.charge is None:  # no side has published yet
            return BEFORE_CONTROL
        token = state.charge.token
        return (self.order[token.robot], token.epoch, int(state.charge.site is Site.CLOUD))

    def _check_cloud_message(self, envelope: Envelope, age_s: float) -> None:
        named_s = self.named_s.get(envelope.token)
        limit_s = self.settings.lease_s * (1 + DRIFT) + HANDOVER_S
        if named_s is None or self.world.now - named_s > limit_s:
            self.violated("1c", "a cloud message passed under a token that control does not name (any more)")
        if age_s > self.settings.max_command_age_s * (1 + DRIFT) + HANDOVER_S and not envelope.latched:
            self.violated("1d", f"a cloud message passed {age_s * 1e3:.1f} ms after it had been published there")

    def flipped(self, left: Charge | None) -> None:
        """Note that the collector has changed over between two messages, away from `left`: a commanded changeover."""
        self.flip_s = self.world.now
        self.left_stay = None if left is None else (self.order[left.token.robot], left.token.epoch)

    def _entered(self, lane: Lane, index: int, now: float) -> None:
        """Invariant 4, at the first message of a new stay.

        With nothing wrong for 1 s, a commanded changeover leaves no gap longer than the slower period plus jitter, on
        any rated output. Jitter: three times the wire's typical one, the timers' and the hand-overs'. A side that has
        passed nothing in its stay, such as a robot that took over and was unable to act, left a gap of its own: that is
        invariant 3's. So did one whose node has died (which no fault need have killed).
        """
        commanded = self.flip_s is not None and now - self.flip_s <= self.settings.slower_period_s + self.reaction_s
        if not commanded or self.quiet_s() < 1.0 or index not in self.prompt:
            return
        if self.left_stay is None or lane.rank[:2] != self.left_stay or self._died(index):
            return
        jitter_s = 3 * self.run.scenario.jitter_s + 2 * HANDOVER_S
        gap_s = now - lane.passed_s
        if gap_s > self.settings.slower_period_s + jitter_s:
            self.violated("4", f"a commanded changeover left a gap of {gap_s * 1e3:.1f} ms on output {index}")

    def _died(self, index: int) -> bool:
        """Return whether a replica of the node of an output is dead or was within the last second."""
        name = self.run.scenario.publishers[index]
        replicas = [side.nodes[name] for side in (self.run.robot, self.run.cloud) if name in side.nodes]
        return any(not node.alive or self.world.now - node.running_since_s < 1.0 for node in replicas)

    def _check_lost(self, lane: Lane, last: Message, message: Message) -> None:
        """Invariant 4: within one stay and with nothing wrong since 1 s before, no sequence is missing."""
        if self.quiet_s() > self.world.now - lane.passed_s + 1.0:
            self.violated("4", f"{message.producer}: {message.sequence} passed after {last.sequence}, the rest is lost")

    # -- what leaves the cloud ----------------------------------------------------------------------------------------

    def permitted(self, permission: Permission, robot: str) -> None:
        """Note that the robot's control process renews a permission."""
        for token in _tokens(permission, robot):
            self.permitted_s[token] = self.world.now

    def beat_sent(self, beat: Beat) -> None:
        """Judge vouching: a grant leaves the robot at most two beats after control has renewed this permission."""
        self.sent.came(self.world.now)
        for token in _tokens(beat.body, beat.incarnation) if isinstance(beat.body, Permission) else ():
            age_s = self.world.now - self.permitted_s.get(token, -1e9)
            if age_s > 2 * self.settings.beat_period_s * (1 + DRIFT) + HANDOVER_S:
                self.violated(
                    "vouching", f"a grant left the robot {age_s * 1e3:.1f} ms after control had last permitted it"
                )

    def grant_delivered(self, beat: Beat, sent_true_s: float) -> None:
        """Note that the cloud's control process gets a robot's beat."""
        body = beat.body
        for token in _tokens(body, beat.incarnation) if isinstance(body, Permission) else ():
            self.heard_grant_s[token] = max(self.heard_grant_s.get(token, -1e9), sent_true_s)

    def left_cloud(self, token: Token) -> None:
        """Invariant 2: nothing leaves later than a lease after the robot sent the last grant that the cloud got."""
        now = self.world.now
        if token.epoch:  # presence does not depend on the side in charge
            self.left_s = (now, token)
        lease_s = self.settings.lease_s * (1 + DRIFT) / min(1.0, self.run.cloud.host.rate)  # by the cloud's clock
        granted_s = self.heard_grant_s.get(token, -1e9)
        late_s = now - granted_s - lease_s - self.run.cloud.host.stood_since(granted_s)  # nothing there can tell
        if late_s > 1e-5:
            self.violated("2", f"a message left the cloud {late_s * 1e3:.1f} ms after the end of any lease")

    # -- detection, outputs, order ------------------------------------------------------------------------------------

    def cloud_beat(self, beat: Beat, arrived_s: float) -> None:
        """Judge whether a new beat of the cloud that reached the robot's pulse process is good (protocol section 1)."""
        robot = self.run.robot.control.robot
        beat = unveil(beat, robot.incarnation)
        report, echo = beat.body, beat.echo
        if (
            isinstance(report, CloudReport)
            and echo is not None
            and beat.incarnation == robot.partner
            and echo.incarnation == robot.incarnation == report.serves
            and report.epoch in (robot.epoch, robot.candidate)
            and report.acting
            and arrived_s - echo.sent_us / 1e6 <= self.settings.echo_limit_s
        ):
            self.good_s = self.world.now
            self.handed.came(self.good_s)

    # -- effects that are not collected -------------------------------------------------------------------------------

    def robot_effect(self, robot: placement.Robot) -> None:
        """Invariant 7: admitted effects follow the order of stays in charge, and each stay belongs to one side.

        Before the robot's effect is admitted, no effect of an older stay can leave the cloud any more.
        """
        rank = (self.order[robot.incarnation], robot.epoch)
        self._admit(rank, Site.ROBOT)
        data = self.run.cloud.data
        egress = data.process.egress.egress
        token, may_leave = egress.token, data.host.now_s() < egress.lease_end_s
        if token is None or not data.alive or not may_leave or token.robot not in self.order:
            return
        if data.host.stood_since(self.world.now - 2 * self.settings.lease_s):
            return  # its clock stood still: it believes in a lease that has ended; the collector does not
        if (self.order[token.robot], token.epoch) < rank:
            self.violated("7", f"a robot effect of stay {rank} while the cloud may send under epoch {token.epoch}")

    def cloud_effect(self, token: Token) -> None:
        """Note that the collector has admitted an effect of the cloud."""
        self._admit((self.order.get(token.robot, -2), token.epoch), Site.CLOUD)

    def _admit(self, rank: tuple[int, int], site: Site) -> None:
        if rank < self.effect_rank or (rank == self.effect_rank and site is not self.effect_site):
            held = self.effect_site.value if self.effect_site else "nobody"
            self.violated(
                "7", f"an effect of the {site.value}, stay {rank}, after one of the {held}, {self.effect_rank}"
            )
        self.effect_rank, self.effect_site = rank, site

    # -- consumers in the cloud, inputs, people -----------------------------------------------------------------------

    def input_heard(self, name: str, age_s: float) -> None:
        """Invariant 1g: a message of an input that reaches the cloud's replicas is not older than its `maxAge`.

        By a clock of the cloud that stands still nothing grows older.
        """
        limit_s = self.input_age_s[name]
        stood_s = self.run.cloud.host.stood_since(self.world.now - age_s) if limit_s else 0.0
        if limit_s and age_s - stood_s > limit_s * (1 + DRIFT) + HANDOVER_S:
            self.violated("1g", f"{name} reached the cloud's replicas {age_s * 1e3:.1f} ms after it had been published")

    def answered(self, key: int, accepted: bool, message: str) -> None:
        """Note that a switch by hand was answered."""
