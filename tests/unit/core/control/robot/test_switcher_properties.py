"""Whatever happens in whatever order: epochs only grow, nobody is heard twice, and afterwards all is well again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import hypothesis
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.placement import (
    Answer,
    CloudBeat,
    CloudLeaving,
    Command,
    Event,
    GateReported,
    NodesReported,
    Permit,
    Robot,
    SetPin,
    SetSettings,
    SwitchByHand,
    Wish,
)
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site
from robot_offload_core.words.beats import CloudReport, Echo
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import DataReported, Tick
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.messages import PulseSent, SetGate
from robot_offload_core.words.settings import Mode, Settings
from tests.unit.core.builders import (
    CLOUD,
    NOW_S,
    ROBOT,
    SETTINGS,
    STRANGER,
    acting_report,
    cloud_beat,
    many,
    robot_in,
    us,
)
from tests.unit.core.story import CLOUD_AHEAD_S, Story

some = hypothesis.settings(many, max_examples=30)
stories = hypothesis.settings(many, max_examples=12)

# -- the machine alone, told anything at all


class Machine:
    """One placement machine that hears random words; the collector follows what it was told, or not."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.now_s = robot, NOW_S
        self.offers: list[Charge] = []
        self.commands: list[Command] = []
        self.states: list[Robot] = []

    def hear(self, event: Event) -> None:
        """The commands are written down; a charge once offered may be reported at any later time."""
        self.robot, commands = switcher.step(self.robot, event, self.now_s)
        self.commands += commands
        self.states.append(self.robot)
        for command in commands:
            if isinstance(command, SetGate):
                self.offers += [c for c in (command.gate.current, command.gate.next) if c and c not in self.offers]

    def beat(self, incarnation: str, report: CloudReport | None, echo_back_s: float | None, follows: bool) -> None:
        """A beat of some cloud; `follows`: it says that it acts under what it was granted last."""
        if follows:
            granted = [c.permission for c in self.commands if isinstance(c, Permit) and c.permission.granted]
            report = acting_report(granted[-1].epoch) if granted else report
        echo = None if echo_back_s is None else Echo(ROBOT, 1, us(self.now_s - echo_back_s), 0)
        beat = cloud_beat(self.now_s, None, incarnation=incarnation, body=report, echo=echo)
        self.hear(CloudBeat(beat, self.now_s, 0))

    def tune(self, settings: Settings) -> None:
        """Settings are changed; who observes goes on observing, and who does not does not begin."""
        mode = (self.robot.asked or self.robot.settings).mode
        self.hear(SetSettings(replace(settings, mode=mode), self.robot.inputs))

    def gate(self, back: int, fell_back: bool, flow: bool) -> None:
        """The collector reports one of the charges that it was offered, or none."""
        charge = self.offers[-1 - back] if back < len(self.offers) else None
        self.hear(GateReported(GateReport(charge, fell_back, flow, flow)))


Act = Callable[[Machine], None]


def told(event: Event) -> Act:
    return lambda machine: machine.hear(event)


mostly = st.sampled_from([True, True, True, False])
reports = st.builds(
    CloudReport, st.sampled_from([ROBOT, ROBOT, STRANGER, ""]), st.integers(0, 9), st.booleans(), st.booleans(),
    st.sampled_from(["", "", ROBOT]), st.sampled_from([-1, 10_000, 9_000_000]),
    st.lists(st.sampled_from([-1, 50_000]), max_size=2).map(tuple),
)  # fmt: skip
OTHER_SETTINGS = (
    SETTINGS, replace(SETTINGS, lease_s=0.200), replace(SETTINGS, lease_s=0.230, loss_timeout_s=0.060),
    replace(SETTINGS, pin=Site.ROBOT), replace(SETTINGS, pin=Site.CLOUD), replace(SETTINGS, prefer=Site.ROBOT),
)  # fmt: skip
wishes = st.none() | st.builds(Wish, st.sampled_from(Site), st.none() | st.floats(NOW_S, NOW_S + 5))
acts: st.SearchStrategy[Act] = st.one_of(
    st.just(told(Tick())),
    st.booleans().map(lambda ready: told(NodesReported(ready))),
    st.sampled_from(Site).map(lambda site: told(SwitchByHand(site))),
    wishes.map(lambda wish: told(SetPin(wish))),
    st.sampled_from(OTHER_SETTINGS).map(lambda settings: lambda machine: machine.tune(settings)),
    st.builds(
        lambda cloud, for_s: lambda machine: machine.hear(CloudLeaving(cloud, machine.now_s + for_s)),
        st.sampled_from([CLOUD, STRANGER]), st.sampled_from([0.0, 1.0]),
    ),
    st.builds(lambda up, age_s: told(DataReported(up, age_s, CLOUD)), mostly, st.none() | st.floats(0, 0.4)),
    st.builds(
        lambda who, body, echo, follows: lambda machine: machine.beat(who, body, echo, follows),
        st.sampled_from([CLOUD, CLOUD, CLOUD, STRANGER]), st.none() | reports, st.none() | st.floats(0, 0.1), mostly,
    ),
    st.builds(
        lambda back, fell, flow: lambda machine: machine.gate(back, fell, flow),
        st.integers(0, 3), st.sampled_from([False, False, True]), mostly,
    ),
)  # fmt: skip
waits = st.sampled_from([0.0, 0.001, 0.01, 0.01, 0.02, 0.06, 0.3, 2.0])
lives = st.lists(st.tuples(waits, acts), min_size=20, max_size=60)


def lived(phase: Phase, life: list[tuple[float, Act]], settings: Settings = SETTINGS) -> Machine:
    machine = Machine(robot_in(phase, settings=settings))
    machine.hear(Tick())
    for wait_s, act in life:
        machine.now_s += wait_s
        machine.hear(PulseSent(machine.now_s, True))
        act(machine)
    return machine


@some
@given(st.sampled_from(Phase), lives)
def test_epochs_only_grow(phase: Phase, life: list[tuple[float, Act]]) -> None:
    machine = lived(phase, life)
    granted = [c.permission.epoch for c in machine.commands if isinstance(c, Permit)]
    current = [c.gate.current.token.epoch for c in machine.commands if isinstance(c, SetGate)]
    decided = [c.epoch for c in machine.commands if isinstance(c, Decided)]
    for epochs in (granted, current, decided):
        assert all(before <= after for before, after in pairwise(epochs))
    switched = [c.epoch for c in machine.commands if isinstance(c, Decided) and c.switched]
    assert len(switched) == len(set(switched)), "every changeover has an epoch of its own"


@some
@given(st.sampled_from(Phase), lives)
def test_an_epoch_belongs_to_one_side_and_one_cloud_for_ever(phase: Phase, life: list[tuple[float, Act]]) -> None:
    machine = lived(phase, life)
    owners: dict[int, Charge] = {}
    for charge in machine.offers:
        assert owners.setdefault(charge.token.epoch, charge) == charge
    clouds: dict[int, str] = {}
    for command in machine.commands:
        if isinstance(command, Permit) and command.permission.granted:
            epoch, cloud = command.permission.epoch, command.permission.cloud
            assert clouds.setdefault(epoch, cloud) == cloud
            assert owners.get(epoch, Charge(Site.CLOUD, command.permission.token(ROBOT))).site is Site.CLOUD


@some
@given(st.sampled_from(Phase), lives)
def test_the_parts_of_the_state_agree_with_each_other(phase: Phase, life: list[tuple[float, Act]]) -> None:
    for robot in lived(phase, life).states:
        prepares = robot.phase in (Phase.TO_CLOUD, Phase.TO_ROBOT)
        assert (robot.preparation is not None) == prepares
        assert robot.last_epoch >= max(robot.epoch, robot.candidate)
        assert robot.candidate == 0 or robot.candidate > robot.epoch
        assert robot.phase is not Phase.TAKEOVER or not robot.nodes_ready
        assert robot.policy.hold_down_s <= SETTINGS.hold_down_max_s


@some
@given(lives)
def test_who_observes_never_switches_never_grants_and_refuses_every_hand(life: list[tuple[float, Act]]) -> None:
    machine = lived(Phase.ROBOT, life, Settings(mode=Mode.OBSERVE))
    assert (machine.robot.phase, machine.robot.epoch, machine.robot.last_epoch) == (Phase.ROBOT, 3, 3)
    for command in machine.commands:
        assert not (isinstance(command, Permit) and command.permission.granted)
        assert not (isinstance(command, Decided) and command.switched)
        assert not (isinstance(command, Answer) and command.accepted)


@some
@given(st.sampled_from(Phase), lives)
def test_every_decision_and_every_refusal_has_a_reason_and_a_message(
    phase: Phase, life: list[tuple[float, Act]]
) -> None:
    for command in lived(phase, life).commands:
        if isinstance(command, Decided):
            assert command.verdict.reason.isidentifier()
            assert command.verdict.message
        elif isinstance(command, Answer) and not command.accepted:
            assert command.message.startswith("Refused (")


# -- the whole world with faults


def set_part(part: str, name: str, value: object) -> Callable[[Story], None]:
    return lambda story: setattr(getattr(story, part) if part else story, name, value)


FAULTS: dict[str, Callable[[Story], None]] = {
    "up cut": set_part("", "up_cut", True),
    "down cut": set_part("", "down_cut", True),
    "cut": Story.cut,
    "slow link": set_part("", "way_s", 0.060),
    "fast link": set_part("", "way_s", 0.002),
    "robot nodes die": set_part("robot_nodes", "able", False),
    "cloud nodes die": set_part("cloud_nodes", "able", False),
    "robot mute": set_part("robot_nodes", "mute", True),
    "cloud mute": set_part("cloud_nodes", "mute", True),
    "control stands still": set_part("", "control_runs", False),
    "pulse stands still": set_part("", "pulse_runs", False),
    "collector stands still": set_part("", "collector_runs", False),
    "clocks differ": set_part("", "cloud_wall_error_s", 0.3),
    "robot hot": set_part("robot_nodes", "hot", True),
    "by hand to the robot": lambda story: story.tell(SwitchByHand(Site.ROBOT)),
    "by hand to the cloud": lambda story: story.tell(SwitchByHand(Site.CLOUD)),
    "pinned to the robot": lambda story: story.tell(SetPin(Wish(Site.ROBOT))),
    "pinned to the cloud": lambda story: story.tell(SetPin(Wish(Site.CLOUD))),
    "unpinned": lambda story: story.tell(SetPin(None)),
    "a shorter lease": lambda story: story.tell(SetSettings(OTHER_SETTINGS[1], story.robot.inputs)),
    "the lease as before": lambda story: story.tell(SetSettings(SETTINGS, story.robot.inputs)),
    "observing": lambda story: story.tell(SetSettings(replace(SETTINGS, mode=Mode.OBSERVE), story.robot.inputs)),
    "a cloud that is going": lambda story: story.tell(CloudLeaving(CLOUD, story.now_s + 60.0)),
}


def heal(story: Story) -> None:
    """All faults cease."""
    story.cut(False)
    story.way_s = 0.005
    for nodes in (story.robot_nodes, story.cloud_nodes):
        nodes.able, nodes.mute = True, False
    story.control_runs = story.pulse_runs = story.collector_runs = True
    story.cloud_wall_error_s = 0.0
    story.tell(SetSettings(SETTINGS, story.robot.inputs))
    story.tell(CloudLeaving(CLOUD, story.now_s))


steps = st.tuples(st.sampled_from([*FAULTS, *["heal"] * 8]), st.sampled_from([0.03, 0.1, 0.1, 0.3, 0.6]))
troubles = st.lists(steps, min_size=4, max_size=10)


def told_story(trouble: list[tuple[str, float]]) -> Story:
    story = Story()
    story.run(0.5)
    for name, duration_s in trouble:
        (heal if name == "heal" else FAULTS[name])(story)
        story.run(duration_s)
        check(story)
    return story


def check(story: Story) -> None:
    """The invariants of the protocol that hold at any time."""
    own = [message for message in story.passed if not message.lent]
    assert all((a.epoch, a.sequence) < (b.epoch, b.sequence) for a, b in pairwise(own))
    assert all(message.age_s <= SETTINGS.max_command_age_s for message in own)
    sides: dict[int, Site] = {}
    for message in own:
        assert sides.setdefault(message.epoch, message.site) is message.site
    if story.egress.token is not None and story.cloud.stepped_s is not None:
        assert story.egress.lease_end_s - CLOUD_AHEAD_S <= story.now_s + SETTINGS.lease_s


@stories
@given(troubles)
def test_consumers_hear_one_side_at_a_time_in_order_and_nothing_old(trouble: list[tuple[str, float]]) -> None:
    told_story(trouble)


@stories
@given(troubles)
def test_when_faults_have_ceased_one_side_acts_again(trouble: list[tuple[str, float]]) -> None:
    story = told_story(trouble)
    heal(story)
    story.tell(SetPin(None))
    story.run(3.0)
    began_s = story.now_s
    story.run(0.5)
    check(story)
    assert story.gap_s(began_s) <= 2 * SETTINGS.slower_period_s
    assert story.passed[-1].at_s >= story.now_s - SETTINGS.slower_period_s


@stories
@given(troubles)
def test_what_leaves_the_cloud_is_never_later_than_a_lease_after_the_grant_was_sent(
    trouble: list[tuple[str, float]],
) -> None:
    story = told_story(trouble)
    permits = [at_s for at_s, command in story.of(Permit) if command.permission.granted]
    story.cut()
    story.run(SETTINGS.lease_s + 0.010)
    assert story.egress.token is None, "no grant arrives any more"
    assert permits == [] or story.cloud.lease.end_s - CLOUD_AHEAD_S <= story.now_s
