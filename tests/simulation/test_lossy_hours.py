"""Takeovers by silence in an hour on a lossy link: the collector's and control's rule on the messages of such a link.

The stories run whole systems, for minutes. Here only the rule runs, for an hour: what is lost, late and sent again is
drawn, the collector hears it, and control judges what the collector misses.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace

import pytest

from robot_offload_core.collector import gate as collectors
from robot_offload_core.collector import standby
from robot_offload_core.collector.state import Collector
from robot_offload_core.control.robot import fast_takeover
from robot_offload_core.control.robot.placement import Robot
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.grant import Grant
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.settings import OutputSpec, Settings

pytestmark = [pytest.mark.simulation]
HOUR_S = 3600.0
PERIOD_S = 0.05
"""Declared, and of the robot's replica."""
DEADLINE_S = 0.15
LOSS = 0.03
LEAST_S, JITTER_S = 0.0175, 0.005
"""One way: 35 to 45 ms there and back."""
REPEAT_S = 2 * LEAST_S + 0.02
"""What it takes to send a lost message again."""
AWAY_S = 0.3
"""From the judgement to the next stay in the cloud."""
TICK_S = 0.01
BOTH = (Site.ROBOT, Site.CLOUD)
COMMANDS = OutputSpec("cmd_vel", DEADLINE_S, PERIOD_S, nodes=("controller",), hot=BOTH)
ROBOT, CLOUD = "a" * 32, "c" * 32


@dataclass
class Count:
    """What ended stays: mistakes by silence, and the output's deadline."""

    mistakes: int = 0
    deadlines: int = 0


def arrivals(dice: random.Random, period_s: float, *, reliable: bool) -> Iterator[tuple[float, bool, int]]:
    """Yields what arrives from the cloud, with sequences, and what the robot's replica says; times in order."""
    waiting: list[tuple[float, bool, int]] = []
    tail_s = 0.0
    robot_s = dice.random() * PERIOD_S
    for sequence in range(int(HOUR_S / period_s)):
        sent_s = sequence * period_s
        while robot_s <= sent_s:
            heapq.heappush(waiting, (robot_s, False, sequence))
            robot_s += PERIOD_S
        while waiting and waiting[0][0] <= sent_s:
            yield heapq.heappop(waiting)
        arrival_s = sent_s + LEAST_S + JITTER_S * dice.random()
        while dice.random() < LOSS:
            arrival_s += REPEAT_S if reliable else HOUR_S
        if arrival_s < HOUR_S:
            tail_s = max(arrival_s, tail_s) if reliable else arrival_s
            heapq.heappush(waiting, (tail_s, True, sequence))


class Rule:
    """The collector's and control's part in the rule. `left_s`: when the robot took over; None in the cloud."""

    def __init__(self) -> None:
        self.settings = Settings()
        granted = Grant(ROBOT, 0.0, cloud=CLOUD)
        self.robot = Robot(granted, 1, self.settings, outputs=(COMMANDS,), hot=True, nodes_ready=True)
        self.collector: Collector = collectors.start((COMMANDS,), 1.0, 1e9, self.settings.loss_timeout_s)
        self.count = Count()
        self.left_s: float | None = None
        self.enter(0.0)

    def enter(self, now_s: float) -> None:
        """Begins a stay in the cloud."""
        epoch = self.robot.last_epoch + 1
        granted = replace(self.robot.grant, site=Site.CLOUD, epoch=epoch, last_epoch=epoch)
        self.robot = replace(self.robot, grant=granted, phase=Phase.CLOUD, charged_s=now_s)
        self.token, self.left_s = Token(ROBOT, epoch, CLOUD), None
        self.gate(Charge(Site.CLOUD, self.token), now_s)

    def leave(self, now_s: float) -> None:
        """Ends the stay: the robot acts."""
        epoch = self.robot.last_epoch + 1
        granted = replace(self.robot.grant, site=Site.ROBOT, epoch=epoch, last_epoch=epoch)
        self.robot = replace(self.robot, grant=granted, phase=Phase.ROBOT)
        self.left_s = now_s
        self.gate(Charge(Site.ROBOT, Token(ROBOT, epoch, "")), now_s)

    def gate(self, charge: Charge, now_s: float) -> None:
        """Says to the collector who passes, and what the mistakes have taught."""
        self.collector = collectors.set_gate(
            self.collector, Gate(1, charge, floors=fast_takeover.floors(self.robot, now_s)), now_s
        )

    def hear(self, now_s: float, of_cloud: bool, sequence: int) -> None:
        """Takes a message; before it, what its absence meant."""
        self.look(now_s)
        if not of_cloud:
            self.collector = collectors.offer_robot(self.collector, 0, sequence, now_s)[0]
        elif self.left_s is None or now_s - self.left_s < 2 * LEAST_S:  # what was under way when the robot took over
            envelope = Envelope(self.token, sequence, round((now_s - LEAST_S) * 1e6))
            self.collector = collectors.offer_cloud(self.collector, 0, envelope, now_s)[0]

    def look(self, until_s: float) -> None:
        """Lets time pass until a message arrives."""
        if self.left_s is not None:
            self.judge(until_s)
            return
        self.robot = fast_takeover.prove(self.robot, until_s)
        late = self.collector.outputs[0].late
        heard_s = late.arrived_s if late.token == self.token else None
        due_s = standby.next_look_s(self.collector, 0.0)
        if heard_s is not None and due_s <= until_s:
            self.miss(due_s)
        if heard_s is not None and self.left_s is None and heard_s + DEADLINE_S <= until_s:
            self.miss(heard_s + DEADLINE_S)

    def miss(self, due_s: float) -> None:
        """Looks for a message that is overdue, as both processes do a little later."""
        self.collector = standby.look(self.collector, due_s)
        now_s = due_s + TICK_S / 2
        report = collectors.report(self.collector, now_s)
        self.robot = replace(self.robot, situation=replace(self.robot.situation, gate=report))
        if not report.cloud_flows:
            self.count.deadlines += 1
            self.leave(now_s)
        elif fast_takeover.missed(self.robot) is not None:
            self.robot = fast_takeover.taken(self.robot, now_s)
            self.leave(now_s)

    def judge(self, now_s: float) -> None:
        """Judges the takeover; the cloud is used again afterwards."""
        assert self.left_s is not None
        taken = self.robot.early.taken_s is not None
        self.robot = fast_takeover.judge(self.robot, None, now_s, [])
        self.count.mistakes += taken and self.robot.early.taken_s is None
        if self.robot.early.taken_s is None and now_s - self.left_s > AWAY_S:
            self.enter(now_s)


def hour(seed: int, period_s: float, *, reliable: bool) -> Count:
    """Returns what ended stays within an hour."""
    rule = Rule()
    for at_s, of_cloud, sequence in arrivals(random.Random(seed), period_s, reliable=reliable):
        rule.hear(at_s, of_cloud, sequence)
    return rule.count


@pytest.mark.parametrize("reliable", [False, True])
@pytest.mark.parametrize("period_s", [PERIOD_S, 0.02])
@pytest.mark.parametrize("seed", range(3))
def test_an_hour_over_a_lossy_link_has_two_mistakes_by_silence_at_most(
    seed: int, period_s: float, reliable: bool
) -> None:
    assert hour(seed, period_s, reliable=reliable).mistakes <= 2
