"""A whole world in virtual time: placement machine, collector, both pulses, the cloud's lease, and a link between them.

All deciding parts are the real ones. Told here are only the nodes (how long they take to wake, whether they can) and
the link (how long a way takes, which direction is cut). A test sets the scene, lets time run and
looks at what happened.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count, pairwise
from typing import TypeVar

from robot_offload_core.collector import gate
from robot_offload_core.control.cloud import lease
from robot_offload_core.control.robot import changeovers, placement, switcher
from robot_offload_core.control.robot.placement import Answer, Permit, Robot
from robot_offload_core.fence import grant
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site
from robot_offload_core.pulse import pulse
from robot_offload_core.words import beats
from robot_offload_core.words.beats import Beat, Permission
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import Acting, CloudData, DataReported, SetEgress
from robot_offload_core.words.gates import Passage
from robot_offload_core.words.messages import PulseSent, Reopen, SetGate
from robot_offload_core.words.settings import OutputSpec, Settings
from tests.unit.core.builders import CLOUD, NOW_S, ROBOT, SCAN, SETTINGS, UID, us

TICK_S = 0.005
CLOUD_AHEAD_S = 5000.0
"""The cloud's steady clock minus the robot's: nobody may ever compare them."""
WALL_US = us(1e6)
NEVER_S = float("inf")
Kind = TypeVar("Kind", bound=placement.Command)


@dataclass(frozen=True)
class Passed:
    """A message that reached the consumers; `lent`: of the robot while the collector waited for a silent control."""

    at_s: float
    site: Site
    epoch: int
    sequence: int
    age_s: float
    lent: bool


class Nodes:
    """The duplicated CORE nodes of one side: awake `wake_s` after they were wanted, unless they are not able."""

    def __init__(self, wake_s: float, period_s: float) -> None:
        self.wake_s, self.period_s = wake_s, period_s
        self.hot = False
        self.able = True
        self.mute = False  # Active, but their output does not come
        self.wanted_s: float | None = None
        self.sequence = 0

    def ready(self, now_s: float) -> bool:
        """All Active."""
        awake = self.hot or (self.wanted_s is not None and now_s - self.wanted_s >= self.wake_s)
        return self.able and awake

    def want(self, wanted: bool, now_s: float) -> None:
        """The guardian's word."""
        self.wanted_s = None if not wanted else now_s if self.wanted_s is None else self.wanted_s


class Story:
    """The world; see the module. `now_s` is the robot's steady clock."""

    def __init__(self, settings: Settings = SETTINGS) -> None:
        self.now_s = NOW_S
        self.settings = settings
        granted = grant.start(ROBOT, NOW_S, changeovers.stopped_s(settings))
        self.robot = Robot(granted, us(NOW_S), settings, (SCAN,))
        self.robot_pulse = pulse.Pulse(UID, Site.ROBOT, settings.beat_period_s)
        self.cloud = lease.start(CLOUD, settings)
        self.cloud_pulse = pulse.Pulse(UID, Site.CLOUD, settings.beat_period_s)
        self.gate = gate.start((OutputSpec("cmd_vel", 0.150),), settings.max_command_age_s, settings.lease_s)
        self.robot_nodes = Nodes(0.030, settings.robot_period_s)
        self.cloud_nodes = Nodes(0.030, settings.cloud_period_s)
        self.way_s = 0.005
        self.up_cut = self.down_cut = False
        self.cloud_wall_error_s = 0.0
        self.control_runs = self.pulse_runs = self.collector_runs = True
        self.passed: list[Passed] = []
        self.told: list[tuple[float, placement.Command]] = []
        self.egress = SetEgress(None, 0.0)
        self._heard_s: float | None = None
        self._ticks = 0
        self._order = count()
        self._inbox: list[placement.Event] = []
        self._link: list[tuple[float, int, Callable[[], None]]] = []

    # -- what a test does

    def run(self, duration_s: float) -> None:
        """Time passes."""
        for _ in range(round(duration_s / TICK_S)):
            self._tick()

    def until(self, condition: Callable[[], bool], limit_s: float = 20.0) -> float:
        """Time passes until `condition`; returns how long that was."""
        began_s = self.now_s
        while not condition():
            assert self.now_s - began_s < limit_s, f"nothing within {limit_s} s; {self.robot.phase}, {self.reason}"
            self._tick()
        return self.now_s - began_s

    def until_in(self, phase: Phase, limit_s: float = 20.0) -> float:
        """Time passes until the machine is in `phase`."""
        return self.until(lambda: self.robot.phase is phase, limit_s)

    def hand(self, site: Site) -> Answer:
        """One of the four services is called."""
        self.tell(placement.SwitchByHand(site, key=1))
        return self.of(Answer)[-1][1]

    def tell(self, event: placement.Event) -> None:
        """An event for the placement machine; it waits in the inbox while control does not run."""
        self._inbox.append(event)
        while self.control_runs and self._inbox:
            self.robot, commands = switcher.step(self.robot, self._inbox.pop(0), self.now_s)
            for command in commands:
                self.told.append((self.now_s, command))
                self._carry_out(command)

    def cut(self, cut: bool = True) -> None:
        """The link is cut, or whole again."""
        self.up_cut = self.down_cut = cut

    # -- what a test looks at

    @property
    def reason(self) -> str:
        """Of the last decision."""
        return self.robot.decided.reason

    def of(self, kind: type[Kind]) -> list[tuple[float, Kind]]:
        """Commands of one kind, with their times."""
        return [(at_s, command) for at_s, command in self.told if isinstance(command, kind)]

    def decisions(self, since_s: float = 0.0) -> list[tuple[Phase, str]]:
        """Phase and reason of each decision told."""
        return [(d.phase, d.verdict.reason) for at_s, d in self.of(Decided) if at_s >= since_s]

    def switches(self) -> list[Decided]:
        """Decisions with which the side in charge changed."""
        return [decided for _, decided in self.of(Decided) if decided.switched]

    def gap_s(self, since_s: float = 0.0) -> float:
        """The longest time without a message at the consumers."""
        times_s = [message.at_s for message in self.passed if message.at_s >= since_s]
        return max((b - a for a, b in pairwise(times_s)), default=NEVER_S)

    # -- how the world goes on

    def _tick(self) -> None:
        self._ticks += 1
        self.now_s += TICK_S
        while self._link and self._link[0][0] <= self.now_s:
            heapq.heappop(self._link)[2]()
        if self._ticks % 4 == 0:
            self._beat()
        if self._ticks % 4 == 2:
            self._report()
        if self._ticks % 2 == 0:
            self._cloud_event(lease.CloudNodes(self.cloud_nodes.ready(self.now_s)))
            self.tell(placement.NodesReported(self.robot_nodes.ready(self.now_s)))
        self._publish()

    def _beat(self) -> None:
        if self.pulse_runs:
            self.robot_pulse, beat = pulse.compose(self.robot_pulse, self.now_s, WALL_US)
            granted = isinstance(beat.body, Permission) and beat.body.granted
            self.tell(PulseSent(self.now_s, granted))
            self._send(self.up_cut, lambda: self._cloud_hears(beats.decode(beats.encode(beat))))
        wall_us = WALL_US - us(CLOUD_AHEAD_S) + us(self.cloud_wall_error_s)
        self.cloud_pulse, answer = pulse.compose(self.cloud_pulse, self.now_s + CLOUD_AHEAD_S, wall_us)
        self._send(self.down_cut, lambda: self._robot_hears(beats.decode(beats.encode(answer))))

    def _send(self, cut: bool, arrive: Callable[[], None]) -> None:
        if not cut:
            heapq.heappush(self._link, (self.now_s + self.way_s, next(self._order), arrive))

    def _cloud_hears(self, beat: Beat) -> None:
        cloud_s = self.now_s + CLOUD_AHEAD_S
        self.cloud_pulse, newer = pulse.hear(self.cloud_pulse, beat, cloud_s)
        if newer:
            self._cloud_event(lease.RobotBeat(beat, cloud_s))
            self._cloud_event(CloudData(0.0, (0.050,)))

    def _cloud_event(self, event: lease.Event) -> None:
        cloud_s = self.now_s + CLOUD_AHEAD_S
        self.cloud, commands = lease.step(self.cloud, event, cloud_s)
        for command in commands:
            if isinstance(command, SetEgress):
                self.egress = command
            elif isinstance(command, Acting):
                self.cloud_nodes.want(command.acting, self.now_s)
            elif isinstance(command, lease.SetReport):
                self.cloud_pulse = pulse.speak(self.cloud_pulse, CLOUD, command.report, cloud_s)

    def _robot_hears(self, beat: Beat) -> None:
        self._heard_s = self.now_s
        if not self.pulse_runs:
            return
        self.robot_pulse, newer = pulse.hear(self.robot_pulse, beat, self.now_s)
        if newer:
            self.tell(placement.CloudBeat(beats.unveil(beat, ROBOT), self.now_s, WALL_US))

    def _report(self) -> None:
        age_s = None if self._heard_s is None else self.now_s - self._heard_s
        self.tell(DataReported(True, age_s, CLOUD if self._heard_s else ""))
        if self.collector_runs:
            self.gate = gate.turn(self.gate, self.now_s)
            self.tell(placement.GateReported(gate.report(self.gate, self.now_s)))

    def _publish(self) -> None:
        nodes, every = self.robot_nodes, round(self.robot_nodes.period_s / TICK_S)
        if self._ticks % every == 0 and nodes.ready(self.now_s) and not nodes.mute and self.collector_runs:
            nodes.sequence += 1
            self.gate, passage = gate.offer_robot(self.gate, 0, nodes.sequence, self.now_s)
            self._consume(passage, Site.ROBOT, nodes.sequence, 0.0)
        nodes, every = self.cloud_nodes, round(self.cloud_nodes.period_s / TICK_S)
        held = self.egress.token is not None and self.now_s + CLOUD_AHEAD_S < self.egress.lease_end_s
        if self._ticks % every == 1 and nodes.ready(self.now_s) and not nodes.mute and held:
            heard = pulse.partner(self.cloud_pulse)
            assert self.egress.token is not None
            assert heard is not None
            nodes.sequence += 1
            envelope = Envelope(self.egress.token, nodes.sequence, heard.sent_us)
            self._send(self.down_cut, lambda: self._collect(envelope))

    def _collect(self, envelope: Envelope) -> None:
        if self.collector_runs:
            self.gate, passage = gate.offer_cloud(self.gate, 0, envelope, self.now_s)
            self._consume(passage, Site.CLOUD, envelope.sequence, envelope.age_s(self.now_s))

    def _consume(self, passage: Passage, site: Site, sequence: int, age_s: float) -> None:
        if passage.passes:
            epoch = self.gate.charge.token.epoch if self.gate.charge else 0
            self.passed.append(Passed(self.now_s, site, epoch, sequence, age_s, self.gate.fell_back))

    def _carry_out(self, command: placement.Command) -> None:
        if isinstance(command, Permit):
            self.robot_pulse = pulse.speak(self.robot_pulse, ROBOT, command.permission, self.now_s)
        elif isinstance(command, SetGate):
            if self.collector_runs:
                self.gate = gate.set_gate(self.gate, command.gate, self.now_s)
        elif isinstance(command, Acting):
            self.robot_nodes.want(command.acting, self.now_s)
        elif isinstance(command, Reopen):
            self._link.clear()


def in_cloud(settings: Settings = SETTINGS, robot_hot: bool = False) -> Story:
    """A story in which the cloud has been in charge for two seconds; what happened before is forgotten."""
    story = Story(settings)
    story.robot_nodes.hot = robot_hot
    story.until_in(Phase.CLOUD)
    story.run(2.0)
    story.told.clear()
    story.passed.clear()
    return story


def on_robot(settings: Settings = SETTINGS) -> Story:
    """A story in which the robot has been in charge for a while, pinned there, beside an able cloud."""
    story = Story(settings)
    story.tell(placement.SetPin(placement.Wish(Site.ROBOT)))
    story.run(2.0)
    assert story.robot.phase is Phase.ROBOT
    story.told.clear()
    story.passed.clear()
    return story
