"""The fence under random words of control and random messages: what passes is strictly increasing and never old."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.collector import gate
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.gates import Gate, Passage
from robot_offload_core.words.settings import OutputSpec
from tests.unit.core.builders import CLOUD, NOW_S, ROBOT, STRANGER, few, many, us

OUTPUTS = (OutputSpec("cmd_vel", 0.150), OutputSpec("lights", 0.300), OutputSpec("plan", 0.0))
MAX_AGE_S = 0.150
TIMEOUT_S = 0.250
STEP_S = 0.010


def charged(epoch: int) -> Charge:
    """The side in charge under an epoch: here the robot has the odd ones."""
    site = Site.CLOUD if epoch % 2 == 0 else Site.ROBOT
    return Charge(site, Token(ROBOT, epoch, CLOUD if site is Site.CLOUD else ""))


@dataclass(frozen=True)
class Decide:
    """Control puts a side in charge at once, or lets the other side get ready under the next epoch, or not any more."""

    ahead: int
    prepares: bool


@dataclass(frozen=True)
class CloudSends:
    """A message of the cloud arrives, under the current epoch plus `off`, at this age: in any order, also twice.

    Its sequence grows with the time of sending, as a real sender's does.
    """

    output: int
    off: int
    age_s: float
    cloud: str


@dataclass(frozen=True)
class RobotSends:
    """The robot's replica publishes on an output."""

    output: int


@dataclass(frozen=True)
class Wait:
    """Time passes; control, unless it hangs, repeats what it said."""

    duration_s: float
    hangs: bool = False


@dataclass(frozen=True)
class Restart:
    """The collector dies and its successor takes up what it had reached."""


outputs = st.integers(0, len(OUTPUTS) - 1)
cloud_sends = st.builds(
    CloudSends, outputs, st.sampled_from([0, 0, 0, 1, -1]), st.one_of(st.floats(-0.01, 0.2), *[st.floats(0, 0.05)] * 2),
    st.sampled_from([*[CLOUD] * 9, STRANGER]),
)  # fmt: skip
robot_sends = st.builds(RobotSends, outputs)
waits = st.builds(Wait, st.floats(0, 0.05))
decisions = st.builds(Decide, st.sampled_from([0, 0, 1, 2]), st.booleans())
hangs = st.builds(Wait, st.floats(0, 0.4), st.just(True))
histories = st.lists(
    st.one_of(*[cloud_sends] * 14, *[robot_sends] * 7, *[waits] * 5, *[decisions] * 4, hangs, st.just(Restart())),
    min_size=60,
    max_size=120,
)
"""Mostly messages, so that something passes between two disturbances."""


class World:
    """One control process, one collector, and what its consumers have heard."""

    def __init__(self) -> None:
        self.now_s = NOW_S
        self.state = gate.start(OUTPUTS, MAX_AGE_S, TIMEOUT_S)
        self.wish = Gate(1, charged(1))
        self.sequence = 0
        self.charges: list[Charge] = []
        self.kept: dict[int, tuple[int, float]] = {}  # output -> (sequence, born) of the message held for it
        self.passed: dict[int, list[tuple[int, int]]] = {index: [] for index in range(len(OUTPUTS))}
        self._said()

    def happen(self, what: object) -> None:
        if isinstance(what, Wait):
            until_s = self.now_s + what.duration_s
            while self.now_s < until_s:
                self.now_s = min(until_s, self.now_s + STEP_S)
                if not what.hangs:
                    self._said()
        elif isinstance(what, Decide):
            self._decide(what)
        elif isinstance(what, RobotSends):
            self._said()
            self.sequence += 1
            self.state, passage = gate.offer_robot(self.state, what.output, self.sequence, self.now_s)
            self._heard(what.output, self.sequence, self.now_s, passage)
        elif isinstance(what, CloudSends):
            self._cloud_sends(what)
        elif self.state.charge is not None:
            was, fresh = self.state, gate.start(OUTPUTS, MAX_AGE_S, TIMEOUT_S)
            self.state = gate.resume(fresh, was.charge, was.started_us, was.fell_back, self.now_s)  # type: ignore[arg-type]
            self.kept.clear()
        if self.state.charge is not None and self.state.charge not in self.charges[-1:]:
            self.charges.append(self.state.charge)

    def _said(self) -> None:
        """As control does it: it takes over under a new epoch when it reads that the collector fell back."""
        charge = self.state.charge
        if self.state.fell_back and charge is not None and charge.site is Site.CLOUD:
            self._take(charge.token.epoch + 1, prepares=False)
        self.state = gate.set_gate(self.state, self.wish, self.now_s)

    def _decide(self, decision: Decide) -> None:
        """As control does it: it hears of a changeover first, and never uses an epoch for two sites."""
        reached = self.state.charge.token.epoch if self.state.charge else 1
        self._take(max(self.wish.current.token.epoch, reached) + decision.ahead, decision.prepares)
        self._said()

    def _take(self, epoch: int, prepares: bool) -> None:
        self.wish = Gate(1, charged(epoch), charged(epoch + 1) if prepares else None)

    def _cloud_sends(self, what: CloudSends) -> None:
        epoch = self.wish.next.token.epoch if self.wish.next else self.wish.current.token.epoch
        token = Token(ROBOT, epoch - epoch % 2 + 2 * what.off, what.cloud)
        born_us = us(self.now_s - what.age_s)
        before = self.state
        self.state, passage = gate.offer_cloud(before, what.output, Envelope(token, born_us, born_us), self.now_s)
        if passage.passes:
            assert self.state.charge is not None
            assert self.state.charge.token == token, "what passes carries the token that is current then"
            assert -1e-5 <= what.age_s <= MAX_AGE_S + 1e-5
            assert not gate.tick(before, self.now_s).fell_back
        self._heard(what.output, born_us, self.now_s - what.age_s, passage)

    def _heard(self, output: int, sequence: int, born_s: float, passage: Passage) -> None:
        if passage.reason == "NotAllReady":
            self.kept[output] = (sequence, born_s)
        if passage.reason == "ChangedOver":
            assert output not in passage.also
            for other in passage.also:
                kept_sequence, kept_born_s = self.kept[other]
                assert self.now_s - kept_born_s <= MAX_AGE_S + 1e-5
                self._note(other, kept_sequence)
            self.kept.clear()
        lent = self.state.fell_back and self.state.charge is not None and self.state.charge.site is Site.CLOUD
        if passage.passes and self.state.charge is not None and not lent:
            self._note(output, sequence)

    def _note(self, output: int, sequence: int) -> None:
        assert self.state.charge is not None
        self.passed[output].append((self.state.charge.token.epoch, sequence))


def lived(history: list[object]) -> World:
    world = World()
    for what in history:
        world.happen(what)
    return world


@many
@given(histories)
def test_what_passes_is_strictly_increasing_in_epoch_and_sequence(history: list[object]) -> None:
    for passed in lived(history).passed.values():
        assert passed == sorted(set(passed))


@many
@given(histories)
def test_no_epoch_is_entered_twice_and_none_is_gone_back_to(history: list[object]) -> None:
    epochs = [charge.token.epoch for charge in lived(history).charges]
    assert epochs == sorted(set(epochs))


@few
@given(histories, outputs)
def test_without_control_the_robot_always_passes_and_the_cloud_never(history: list[object], output: int) -> None:
    world = lived(history)
    late_s = world.now_s + TIMEOUT_S + 0.5
    assert gate.offer_robot(world.state, output, world.sequence + 1, late_s)[1].reason == "RobotInCharge"
    token = world.state.charge.token if world.state.charge else charged(4).token
    assert not gate.offer_cloud(world.state, output, Envelope(token, us(late_s), us(late_s)), late_s)[1].passes


@few
@given(histories)
def test_at_no_moment_both_sides_pass(history: list[object]) -> None:
    world = lived(history)
    token = world.state.charge.token if world.state.charge else charged(4).token
    newest = Envelope(token, us(world.now_s), us(world.now_s))
    robot, _ = gate.offer_robot(world.state, 0, world.sequence + 1, world.now_s)
    both = [
        gate.offer_robot(world.state, 0, world.sequence + 1, world.now_s)[1].reason == "RobotInCharge",
        gate.offer_cloud(robot, 0, newest, world.now_s)[1].reason == "Current",
    ]
    assert not all(both)
