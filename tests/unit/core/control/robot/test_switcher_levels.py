"""What the shell keeps up is told again with every beat; effects wait for the lease; a stall of ours is no silence."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from robot_offload_core.control.robot import changeovers, switcher
from robot_offload_core.control.robot.placement import GateReported, Permit, Robot, SetPin, SwitchByHand, Wish
from robot_offload_core.fence import grant
from robot_offload_core.fence.token import Site
from robot_offload_core.words import slow_outputs
from robot_offload_core.words.beats import PERMISSION_BEATS
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import Acting, Tick
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.messages import SetGate
from robot_offload_core.words.settings import STALL_BEATS, OutputSpec
from tests.unit.core.builders import (
    BEAT_S,
    NOW_S,
    ROBOT,
    SETTINGS,
    STARTED_S,
    gate_report,
    good_link,
    none_of,
    only,
    robot_in,
    situation,
)
from tests.unit.core.story import TICK_S, in_cloud, on_robot

# -- levels


@pytest.mark.parametrize("kind", [Permit, SetGate, Acting])
@pytest.mark.parametrize("phase", Phase)
def test_all_levels_are_told_with_the_first_step(phase: Phase, kind: type[Permit | SetGate | Acting]) -> None:
    assert only(switcher.step(robot_in(phase), Tick(), NOW_S)[1], kind)


@pytest.mark.parametrize("kind", [Permit, SetGate, Acting])
def test_levels_are_told_again_every_beat_period_although_nothing_changes(
    kind: type[Permit | SetGate | Acting],
) -> None:
    for story in (in_cloud(), on_robot()):
        story.run(1.0)
        times_s = [at_s for at_s, _ in story.of(kind)]
        assert max(b - a for a, b in pairwise(times_s)) <= BEAT_S + TICK_S
        assert len(times_s) <= 1.0 / BEAT_S + 2, "and not more often"


def test_a_level_that_changes_is_told_at_once() -> None:
    robot, _ = switcher.step(robot_in(), Tick(), NOW_S)
    robot, commands = switcher.step(robot, Tick(), NOW_S + 0.001)
    assert none_of(commands, Permit)
    robot, commands = switcher.step(robot, SwitchByHand(Site.CLOUD), NOW_S + 0.002)
    assert only(commands, Permit).permission.granted


def test_a_gate_carries_when_it_was_said() -> None:
    assert only(switcher.step(robot_in(), Tick(), NOW_S)[1], SetGate).gate.said_s == NOW_S


@pytest.mark.parametrize(
    ("phase", "acting", "in_charge"),
    [
        (Phase.ROBOT, True, True),
        (Phase.TO_CLOUD, True, True),
        (Phase.CLOUD, False, False),
        (Phase.TO_ROBOT, True, False),
        (Phase.TAKEOVER, True, True),
    ],
)
def test_the_robots_nodes_are_wanted_whenever_the_robot_acts_or_gets_ready(
    phase: Phase, acting: bool, in_charge: bool
) -> None:
    told = only(switcher.step(robot_in(phase), Tick(), NOW_S)[1], Acting)
    assert (told.acting, told.in_charge) == (acting, in_charge)


@pytest.mark.parametrize(
    ("phase", "epoch", "granted"),
    [
        (Phase.ROBOT, 3, False),
        (Phase.TO_CLOUD, 4, True),
        (Phase.CLOUD, 4, True),
        (Phase.TO_ROBOT, 4, True),
        (Phase.TAKEOVER, 5, False),
    ],
)
def test_the_cloud_is_granted_its_own_epoch_while_it_acts_or_gets_ready(
    phase: Phase, epoch: int, granted: bool
) -> None:
    told = only(switcher.step(robot_in(phase), Tick(), NOW_S)[1], Permit).permission
    assert (told.epoch, told.granted) == (epoch, granted)


# -- the robot's own outputs


def flow(robot: Robot, now_s: float = NOW_S) -> bool:
    told = only(switcher.step(robot, Tick(), now_s)[1], Acting)
    assert isinstance(told, Acting)
    return told.outputs_flow


def heard(robot: Robot, now_s: float = NOW_S) -> bool:
    told = only(switcher.step(robot, Tick(), now_s)[1], Acting)
    assert isinstance(told, Acting)
    return told.outputs_heard


OUTPUTS = (OutputSpec("cmd_vel", 0.15), OutputSpec("plan", 0.0), OutputSpec("status", 40.0))


@pytest.mark.parametrize(
    ("report", "expected"),
    [
        (gate_report(Site.ROBOT, 3, robot_flowing=(0, 2)), True),
        (gate_report(Site.ROBOT, 3, robot_flowing=(2,)), False),
        (gate_report(Site.CLOUD, 2, robot_flowing=(0, 2)), False),
        (gate_report(Site.CLOUD, 2, robot_flowing=(0, 2), fell_back=True), True),
        (gate_report(Site.ROBOT, 3, robot_flowing=(0,)), False),
    ],
    ids=["all", "one silent", "held back", "fell back", "the slow one too"],
)
def test_outputs_count_as_heard_when_the_collector_passes_a_message_of_each(report: GateReport, expected: bool) -> None:
    robot = robot_in(outputs=OUTPUTS, charged_s=NOW_S - 60.0, situation=situation(gate=report))
    assert heard(robot) is expected


def test_outputs_that_are_slower_than_nodes_wake_have_a_deadline_for_their_first_message() -> None:
    told = situation(gate=gate_report(Site.ROBOT, 3, robot_flowing=(0,)))
    slow = slow_outputs.start(OUTPUTS)
    assert heard(robot_in(outputs=OUTPUTS, slow=slow, charged_s=NOW_S - 39.0, situation=told))
    assert not heard(robot_in(outputs=OUTPUTS, slow=slow, charged_s=NOW_S - 41.0, situation=told))


def test_a_slow_output_that_was_seen_not_long_ago_is_heard_although_the_collector_has_none() -> None:
    told = situation(gate=gate_report(Site.ROBOT, 3, robot_flowing=(0,)))
    seen = slow_outputs.see(slow_outputs.start(OUTPUTS), (2,), NOW_S - 39.0)
    assert heard(robot_in(outputs=OUTPUTS, slow=seen, charged_s=NOW_S - 60.0, situation=told))
    seen = slow_outputs.see(seen, (2,), NOW_S - 41.0)
    assert not heard(robot_in(outputs=OUTPUTS, slow=seen, charged_s=NOW_S - 60.0, situation=told))


@pytest.mark.parametrize(("woken_s", "flows"), [(NOW_S - 39.0, True), (NOW_S - 41.0, False)])
def test_a_slow_output_is_not_silent_before_its_node_had_its_deadline_again(woken_s: float, flows: bool) -> None:
    told = situation(gate=gate_report(Site.ROBOT, 3, robot_flows=False, robot_flowing=(0,), robot_silent=(2,)))
    slow = slow_outputs.see(slow_outputs.start(OUTPUTS), (2,), NOW_S - 100.0)
    slow = slow_outputs.wake(slow_outputs.wake(slow, (2,), NOW_S - 90.0), (), woken_s)
    assert flow(robot_in(outputs=OUTPUTS, slow=slow, charged_s=NOW_S - 200.0, situation=told)) is flows


def test_a_second_return_of_a_node_without_a_message_between_earns_no_second_deadline() -> None:
    slow = slow_outputs.see(slow_outputs.start(OUTPUTS), (2,), NOW_S - 100.0)
    for returned_s in (NOW_S - 41.0, NOW_S - 1.0):
        slow = slow_outputs.wake(slow_outputs.wake(slow, (2,), returned_s - 1.0), (), returned_s)
    assert not slow[-1].excused(NOW_S)
    slow = slow_outputs.wake(slow_outputs.wake(slow_outputs.see(slow, (2,), NOW_S), (2,), NOW_S), (), NOW_S)
    assert slow[-1].excused(NOW_S)


def test_an_old_report_of_the_collector_proves_no_message() -> None:
    told = situation(gate=gate_report(Site.ROBOT, 3, robot_flowing=(0, 2)), gate_s=NOW_S - 1.0)
    assert not heard(robot_in(outputs=OUTPUTS, charged_s=NOW_S - 60.0, situation=told))


def test_silence_of_the_robots_output_is_told_to_the_core_rule() -> None:
    silent = gate_report(Site.ROBOT, 3, robot_flows=False)
    assert flow(robot_in())
    assert not flow(robot_in(situation=situation(gate=silent)))


def test_the_robots_output_is_not_missed_before_its_nodes_had_their_time() -> None:
    silent = situation(gate=gate_report(Site.ROBOT, 3, robot_flows=False))
    assert flow(robot_in(situation=silent, charged_s=NOW_S - SETTINGS.activation_deadline_s + 0.001))
    assert not flow(robot_in(situation=silent, charged_s=NOW_S - SETTINGS.activation_deadline_s - 0.001))


def test_without_a_collector_nothing_reaches_the_consumers() -> None:
    assert not flow(robot_in(situation=situation(gate_s=NOW_S - SETTINGS.lease_s - 0.001)))
    assert not flow(robot_in(situation=situation(gate=None, gate_s=None)))


def test_at_the_start_the_collector_has_a_lease_of_time_to_report() -> None:
    fresh = robot_in(situation=situation(gate=None, gate_s=None), charged_s=0.0)
    assert flow(fresh, STARTED_S + SETTINGS.lease_s - 0.001)
    assert not flow(fresh, STARTED_S + SETTINGS.lease_s + 0.001)


def test_the_robots_output_is_not_judged_while_the_cloud_acts() -> None:
    silent = situation(Phase.CLOUD, gate=gate_report(Site.CLOUD, 4, robot_flows=False))
    assert flow(robot_in(Phase.CLOUD, situation=silent))


# -- effects that are not collected

CLEAR_S = PERMISSION_BEATS * BEAT_S + SETTINGS.lease_s + SETTINGS.drift_s
"""From the end of the permission until the cloud has stopped for sure."""


def test_after_a_sudden_loss_the_robots_effects_wait_until_the_cloud_has_stopped_for_sure() -> None:
    story = in_cloud(robot_hot=True)
    story.cut()
    story.until_in(Phase.ROBOT)
    taken_s = story.now_s
    admitted_s = story.until(lambda: switcher.effects_site(story.robot, story.now_s) is Site.ROBOT)
    assert admitted_s == pytest.approx(CLEAR_S, abs=2 * TICK_S)
    assert story.egress.token is None
    assert switcher.effects_site(story.robot, taken_s) is None


@pytest.mark.parametrize("cut", [True, False], ids=["link dead", "link alive"])
def test_no_effect_of_both_sides_is_ever_admitted_at_once(cut: bool) -> None:
    story = in_cloud(robot_hot=True)
    if cut:
        story.cut()
    else:
        story.hand(Site.ROBOT)
    for _ in range(300):
        story.run(TICK_S)
        if switcher.effects_site(story.robot, story.now_s) is Site.ROBOT:
            assert story.egress.token is None
    assert switcher.effects_site(story.robot, story.now_s) is Site.ROBOT


def test_while_the_cloud_is_in_charge_its_effects_are_admitted() -> None:
    for phase in (Phase.CLOUD, Phase.TO_ROBOT):
        assert switcher.effects_site(robot_in(phase), NOW_S) is Site.CLOUD


def test_while_the_collector_may_change_over_nobodys_effects_are_admitted() -> None:
    assert switcher.effects_site(robot_in(Phase.TO_CLOUD), NOW_S) is Site.ROBOT
    assert switcher.effects_site(robot_in(Phase.TO_CLOUD, offered=True), NOW_S) is None


def test_after_calling_off_an_offered_preparation_effects_wait_too() -> None:
    robot, _ = switcher.step(robot_in(Phase.TO_CLOUD, offered=True, deadline_s=NOW_S), Tick(), NOW_S)
    assert switcher.effects_site(robot, NOW_S + CLEAR_S - 0.001) is None
    assert switcher.effects_site(robot, NOW_S + CLEAR_S + 0.001) is Site.ROBOT


def test_a_restarted_control_waits_for_what_its_predecessor_may_have_granted() -> None:
    granted = grant.start(ROBOT, STARTED_S, changeovers.stopped_s(SETTINGS))
    fresh = replace(robot_in(), grant=granted)
    assert switcher.effects_site(fresh, STARTED_S + CLEAR_S - 0.001) is None
    assert switcher.effects_site(fresh, STARTED_S + CLEAR_S + 0.001) is Site.ROBOT


# -- our own stall


def silent_since(good_s: float, stepped_s: float) -> Robot:
    """Pinned to the cloud, so that only hard limits count; everything we know is as old as the last good beat."""
    old = situation(Phase.CLOUD, good_s, good_s=good_s)
    return robot_in(Phase.CLOUD, situation=old, link=good_link(good_s), stepped_s=stepped_s, pin=Wish(Site.CLOUD))


def test_a_late_step_of_ours_is_a_stall_and_not_silence() -> None:
    stalled = silent_since(NOW_S - 0.2, stepped_s=NOW_S - 0.190)
    robot, _ = switcher.step(stalled, Tick(), NOW_S)
    assert robot.phase is Phase.CLOUD
    assert robot.stalls.until_s == pytest.approx(NOW_S + SETTINGS.loss_timeout_s)


def test_the_same_silence_without_a_stall_is_a_loss() -> None:
    robot, _ = switcher.step(silent_since(NOW_S - 0.2, stepped_s=NOW_S - 0.010), Tick(), NOW_S)
    assert switcher.site(robot) is Site.ROBOT


@pytest.mark.parametrize(("beats", "stalls"), [(STALL_BEATS - 0.1, False), (STALL_BEATS + 0.1, True)])
def test_a_step_that_is_a_few_beats_late_is_a_stall(beats: float, stalls: bool) -> None:
    robot, _ = switcher.step(robot_in(stepped_s=NOW_S - beats * BEAT_S), Tick(), NOW_S)
    assert (robot.stalls.until_s > NOW_S) is stalls


def test_after_the_grace_silence_is_silence() -> None:
    robot, _ = switcher.step(silent_since(NOW_S - 0.120, stepped_s=NOW_S - 0.110), Tick(), NOW_S)
    for later_s in (0.020, 0.040, 0.060):
        robot, _ = switcher.step(robot, Tick(), NOW_S + later_s)
        assert robot.phase is Phase.CLOUD
    robot, _ = switcher.step(robot, Tick(), NOW_S + SETTINGS.loss_timeout_s + 0.001)
    assert switcher.site(robot) is Site.ROBOT


def test_a_stall_hides_the_end_of_a_stay_for_no_longer_than_a_lease() -> None:
    stalled = silent_since(NOW_S - SETTINGS.lease_s - 0.001, stepped_s=NOW_S - 0.240)
    robot, _ = switcher.step(stalled, Tick(), NOW_S)
    assert (switcher.site(robot), robot.decided.reason) == (Site.ROBOT, "ControlStalled")


def test_stalls_in_a_row_hide_the_end_of_a_stay_for_no_longer_than_a_lease() -> None:
    robot, now_s = silent_since(NOW_S, stepped_s=NOW_S), NOW_S
    while switcher.site(robot) is Site.CLOUD and now_s < NOW_S + 2.0:
        now_s += (STALL_BEATS + 0.5) * BEAT_S
        robot, _ = switcher.step(robot, Tick(), now_s)
    assert now_s - NOW_S <= SETTINGS.lease_s + (STALL_BEATS + 0.5) * BEAT_S


def test_a_stall_of_control_in_a_living_world_is_no_loss_when_its_inbox_is_read_first() -> None:
    story = in_cloud(robot_hot=True)
    story.tell(SetPin(Wish(Site.CLOUD)))  # only hard limits count
    for duration_s in (0.060, 0.100, 0.200):
        story.control_runs = False
        story.run(duration_s)
        story.control_runs = True
        story.run(1.0)
    assert story.switches() == []


def test_a_control_that_stands_still_for_longer_than_a_lease_has_lost_the_cloud() -> None:
    story = in_cloud(robot_hot=True)
    story.control_runs = False
    story.run(SETTINGS.lease_s + PERMISSION_BEATS * BEAT_S + 0.050)
    assert story.egress.token is None, "the pulse process vouched for nobody"
    assert story.gate.fell_back, "the collector passes the robot meanwhile"
    story.control_runs = True
    story.run(0.050)
    assert switcher.site(story.robot) is Site.ROBOT
    assert len(story.switches()) == 1


def test_a_collector_that_fell_back_while_control_stood_still_ends_the_stay() -> None:
    fallen = gate_report(Site.CLOUD, 4, fell_back=True)
    robot, _ = switcher.step(robot_in(Phase.CLOUD), GateReported(fallen), NOW_S)
    assert (switcher.site(robot), robot.decided.reason) == (Site.ROBOT, "CollectorFellBack")


def test_the_levels_of_a_robot_do_not_depend_on_how_often_it_is_stepped() -> None:
    often = seldom = robot_in(pin=Wish(Site.ROBOT))
    for tick in range(1, 41):
        often, _ = switcher.step(often, Tick(), NOW_S + tick * 0.001)
    seldom, _ = switcher.step(seldom, Tick(), NOW_S + 0.020)
    seldom, _ = switcher.step(seldom, Tick(), NOW_S + 0.040)
    assert often.levels == seldom.levels
    assert replace(often, policy=seldom.policy, levels_s=seldom.levels_s, decided_s=seldom.decided_s) == seldom
