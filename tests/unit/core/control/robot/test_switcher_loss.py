"""Sudden loss: the robot is in charge from the moment it is noticed, and nobody else is heard any more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.placement import (
    CloudBeat,
    GateReported,
    NodesReported,
    Permit,
    Robot,
    Stalls,
    Wish,
)
from robot_offload_core.fence.token import Site
from robot_offload_core.link.policies import Policy
from robot_offload_core.words.beats import Beat, Echo
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import Acting, DataReported, Tick
from robot_offload_core.words.messages import Reopen, SetGate
from robot_offload_core.words.settings import OutputSpec, Settings
from tests.unit.core.builders import (
    BEAT_S,
    NOW_S,
    ROBOT,
    SETTINGS,
    STRANGER,
    acting_report,
    charge,
    cloud_beat,
    gate_report,
    good_link,
    none_of,
    only,
    report,
    robot_in,
    situation,
    us,
)
from tests.unit.core.story import CLOUD_AHEAD_S, NEVER_S, TICK_S, Story, in_cloud, on_robot

LOSS_S = SETTINGS.loss_timeout_s
SLACK_S = 2 * BEAT_S
"""A beat is at most one period old when the link is cut, the tick that judges comes a little later."""


def lost_robot(**changes: Any) -> Robot:
    """In the cloud, the last good beat just too long ago."""
    silent = situation(Phase.CLOUD, good_s=NOW_S - LOSS_S - 0.001)
    return robot_in(Phase.CLOUD, situation=silent, link=good_link(NOW_S - LOSS_S - 0.001), **changes)


# -- hot and warm


def test_a_hot_standby_acts_at_once() -> None:
    robot, commands = switcher.step(lost_robot(nodes_ready=True), Tick(), NOW_S)
    assert (robot.phase, robot.epoch, robot.last_epoch, robot.charged_s) == (Phase.ROBOT, 5, 5, NOW_S)
    assert only(commands, SetGate).gate.current == charge(Site.ROBOT, 5)
    assert only(commands, Acting) == Acting(acting=True, outputs_flow=True, in_charge=True)
    assert not only(commands, Permit).permission.granted


def test_a_warm_standby_is_in_charge_at_once_and_acts_when_its_nodes_are_awake() -> None:
    robot, commands = switcher.step(lost_robot(nodes_ready=False), Tick(), NOW_S)
    assert robot.phase is Phase.TAKEOVER
    assert only(commands, SetGate).gate.current == charge(Site.ROBOT, 5), "the cloud is shut out meanwhile"
    assert only(commands, Acting).in_charge, "so that the CORE rule can stop the driver meanwhile"
    robot, _ = switcher.step(robot, NodesReported(True), NOW_S + 0.030)
    assert (robot.phase, robot.epoch) == (Phase.ROBOT, 5)


def test_the_decision_names_the_reason_and_how_long_the_silence_was() -> None:
    _, commands = switcher.step(lost_robot(), Tick(), NOW_S)
    decided = only(commands, Decided)
    assert (decided.site, decided.verdict.reason, decided.switched) == (Site.ROBOT, "HeartbeatLost", True)
    assert decided.silent_s == pytest.approx(LOSS_S + 0.001)
    assert only(commands, Reopen) == Reopen("HeartbeatLost")


@pytest.mark.parametrize("hot", [True, False], ids=["hot", "warm"])
def test_a_cut_is_noticed_within_the_loss_timeout_and_bridged(hot: bool) -> None:
    story = in_cloud(robot_hot=hot)
    story.cut()
    detected_s = story.until(lambda: switcher.site(story.robot) is Site.ROBOT)
    assert detected_s <= LOSS_S + SLACK_S
    assert story.robot.phase is (Phase.ROBOT if hot else Phase.TAKEOVER)
    story.run(1.0)
    wake_s = 0.0 if hot else 0.030
    assert story.gap_s() <= LOSS_S + SLACK_S + wake_s + SETTINGS.robot_period_s + 2 * TICK_S
    assert story.robot.phase is Phase.ROBOT


def test_what_the_cut_link_held_back_reaches_nobody_afterwards() -> None:
    story = in_cloud(robot_hot=True)
    story.way_s = 0.030
    story.run(1.0)
    story.cut()
    story.until_in(Phase.ROBOT)
    story.run(1.0)
    sites = [message.site for message in story.passed]
    assert Site.CLOUD not in sites[sites.index(Site.ROBOT) :]


@pytest.mark.parametrize("direction", ["up_cut", "down_cut"])
def test_the_cut_of_one_direction_alone_is_noticed_by_both_sides(direction: str) -> None:
    story = in_cloud(robot_hot=True)
    setattr(story, direction, True)
    assert story.until_in(Phase.ROBOT) <= SETTINGS.echo_limit_s + SLACK_S
    story.run(SETTINGS.lease_s)
    assert story.egress.token is None


def test_the_cloud_stops_within_a_lease_of_the_last_grant_sent() -> None:
    story = in_cloud(robot_hot=True)
    story.cut()
    cut_s = story.now_s
    stopped_s = story.until(lambda: story.egress.token is None)
    assert stopped_s <= SETTINGS.lease_s + 2 * TICK_S
    assert story.egress.lease_end_s - CLOUD_AHEAD_S <= cut_s + SETTINGS.lease_s


def test_losing_single_beats_is_no_loss() -> None:
    story = in_cloud()
    for _ in range(20):
        story.cut()
        story.run(2.4 * BEAT_S)
        story.cut(False)
        story.run(3 * BEAT_S)
    assert story.switches() == []


# -- what counts as a good beat


def heard(robot: Robot, beat: Beat) -> Robot:
    return switcher.step(robot, CloudBeat(beat, NOW_S, 0), NOW_S)[0]


def in_charge_since(good_s: float) -> Robot:
    """In the cloud, the last good beat at `good_s`, the next one about to be heard."""
    return robot_in(Phase.CLOUD, link=good_link(NOW_S - 0.010), situation=situation(Phase.CLOUD, good_s=good_s))


def test_a_good_beat_renews_the_proof_that_the_cloud_acts() -> None:
    robot = heard(in_charge_since(NOW_S - 0.050), cloud_beat(body=acting_report(4)))
    assert robot.situation.good_s == NOW_S


@pytest.mark.parametrize(
    "beat",
    [
        cloud_beat(body=None),
        cloud_beat(body=acting_report(4), echo=None),
        cloud_beat(body=acting_report(4), echo=Echo(STRANGER, 1, us(NOW_S - 0.010), 0)),
        cloud_beat(body=acting_report(4), echo=Echo(ROBOT, 1, us(NOW_S - 0.2), 0)),
        cloud_beat(body=acting_report(4), incarnation=STRANGER),
    ],
    ids=["bare", "no echo", "echo of another", "echo too old", "of another cloud"],
)
def test_a_beat_that_is_not_good_renews_nothing(beat: Beat) -> None:
    assert heard(in_charge_since(NOW_S - 0.050), beat).situation.good_s == NOW_S - 0.050


@pytest.mark.parametrize(
    "body",
    [acting_report(3), acting_report(5), acting_report(4, serves=STRANGER), acting_report(4, serves="")],
    ids=["older epoch", "newer epoch", "serves another", "serves nobody"],
)
def test_a_cloud_that_says_that_it_acts_for_somebody_else_is_lost_at_once(body: object) -> None:
    robot = heard(in_charge_since(NOW_S - 0.010), cloud_beat(body=body))
    assert switcher.site(robot) is Site.ROBOT
    assert robot.decided.reason in ("CloudNotActing", "NotServed")


def test_a_bare_beat_feeds_statistics_only() -> None:
    before = in_charge_since(NOW_S - 0.050)
    after = heard(before, cloud_beat(body=None, echo=None))
    assert after.situation == before.situation
    assert (after.link.received, after.link.heard_s) == (before.link.received + 1, NOW_S)
    assert after.link.window == before.link.window


def test_bare_beats_alone_keep_no_cloud_in_charge() -> None:
    robot, now_s = in_charge_since(NOW_S), NOW_S
    while switcher.site(robot) is Site.CLOUD and now_s < NOW_S + 1.0:
        now_s += BEAT_S
        bare = CloudBeat(cloud_beat(now_s, echo_s=None, body=None), now_s, 0)
        robot, _ = switcher.step(robot, bare, now_s)
        robot = replace(robot, situation=replace(robot.situation, pulse_s=now_s, gate_s=now_s, data_s=now_s))
    assert now_s - NOW_S <= LOSS_S + BEAT_S


def test_a_second_cloud_agent_is_not_heard_while_the_first_one_is() -> None:
    before = in_charge_since(NOW_S - 0.010)
    after = heard(before, cloud_beat(incarnation=STRANGER, body=acting_report(4)))
    assert (after.link, after.situation) == (before.link, before.situation)


def test_the_next_incarnation_of_the_cloud_is_heard_when_the_first_one_is_silent() -> None:
    robot = robot_in(link=good_link(NOW_S - LOSS_S - 0.001))
    assert heard(robot, cloud_beat(incarnation=STRANGER)).link.peer == STRANGER


def test_a_restarted_cloud_is_never_taken_for_the_one_that_was_in_charge() -> None:
    robot = robot_in(Phase.CLOUD, link=replace(good_link(), peer=STRANGER))
    robot = replace(robot, situation=replace(robot.situation, data_cloud=STRANGER))
    robot, commands = switcher.step(robot, Tick(), NOW_S)
    assert switcher.site(robot) is Site.ROBOT
    assert only(commands, Decided).verdict.reason == "CloudRestarted"


# -- other ends of a stay


def gate_silent(story: Story) -> None:
    story.collector_runs = False


def cloud_nodes_die(story: Story) -> None:
    story.cloud_nodes.able = False


def cloud_falls_mute(story: Story) -> None:
    story.cloud_nodes.mute = True


def pulse_dies(story: Story) -> None:
    story.pulse_runs = False


@pytest.mark.parametrize(
    ("fault", "reason", "within_s"),
    [
        (cloud_nodes_die, "CloudNodesDown", 0.060),
        (cloud_falls_mute, "OutputSilent", 0.200),
        (pulse_dies, "PulseSilent", LOSS_S + SLACK_S),
        (gate_silent, "CollectorSilent", SETTINGS.lease_s + SLACK_S),
    ],
)
def test_a_stay_ends_with_the_reason_that_ended_it(
    fault: Callable[[Story], None], reason: str, within_s: float
) -> None:
    story = in_cloud(robot_hot=True)
    fault(story)
    assert story.until_in(Phase.ROBOT) <= within_s
    assert story.reason == reason


def test_a_data_session_that_dies_ends_the_stay_although_beats_go_on() -> None:
    robot, commands = switcher.step(robot_in(Phase.CLOUD), DataReported(False, 0.010, cloud_beat().incarnation), NOW_S)
    assert switcher.site(robot) is Site.ROBOT
    assert only(commands, Decided).verdict.reason == "DataDisconnected"


# -- afterwards


def test_after_a_loss_the_cloud_is_used_again_when_the_link_is_good_again() -> None:
    story = in_cloud()
    story.cut()
    story.run(1.0)
    story.cut(False)
    assert story.until_in(Phase.CLOUD) <= 5.0
    assert [decided.site for decided in story.switches()] == [Site.ROBOT, Site.CLOUD]


def test_losses_soon_after_a_return_hold_the_cloud_down_longer_each_time() -> None:
    story = in_cloud()
    away_s = []
    for _ in range(4):
        story.run(0.3)
        story.cut()
        story.run(0.3)
        story.cut(False)
        away_s.append(story.until_in(Phase.CLOUD))
    assert away_s[1] >= SETTINGS.hold_down_initial_s - 0.5
    assert away_s[2] >= 1.5 * away_s[1]
    assert away_s[3] >= 1.5 * away_s[2]


def test_a_loss_ends_a_wish_by_hand_for_the_cloud_but_not_one_for_the_robot() -> None:
    for site, after in ((Site.CLOUD, None), (Site.ROBOT, Wish(Site.ROBOT))):
        robot, _ = switcher.step(lost_robot(manual=Wish(site)), Tick(), NOW_S)
        assert robot.manual == after


def test_pinned_to_the_cloud_and_lost_the_robot_acts_and_returns_with_hold_down() -> None:
    held = robot_in(pin=Wish(Site.CLOUD), policy=Policy(hold_until_s=NOW_S + 0.5))
    assert switcher.step(held, Tick(), NOW_S)[0].phase is Phase.ROBOT
    over = replace(held, policy=Policy(hold_until_s=NOW_S))
    assert switcher.step(over, Tick(), NOW_S)[0].phase is Phase.TO_CLOUD


def test_a_cut_right_at_the_start_leaves_the_robot_acting() -> None:
    story = Story()
    story.cut()
    story.run(2.0)
    assert (story.robot.phase, story.reason) == (Phase.ROBOT, "NeverHeard")
    assert story.gap_s() <= SETTINGS.robot_period_s + 1e-6


# -- the robot is unable

HELD = Policy(hold_until_s=NOW_S + 100.0, hold_down_s=30.0)
DEADLINE_S = SETTINGS.activation_deadline_s


def unable(since_s: float, **changes: Any) -> Robot:
    """The robot is in charge, its nodes are down since then, the cloud is well."""
    usual: dict[str, Any] = {"nodes_ready": False, "fell_at_s": since_s, "policy": HELD}
    return robot_in(**(usual | changes))


def test_a_robot_that_cannot_act_returns_at_once_without_dwell_and_hold_down() -> None:
    robot = unable(NOW_S - DEADLINE_S - 0.001, settings=Settings(min_dwell_s=1000.0))
    robot, commands = switcher.step(robot, Tick(), NOW_S)
    assert robot.phase is Phase.TO_CLOUD
    assert only(commands, Decided).verdict.reason == "RobotUnable"


def test_a_robot_has_the_time_that_activation_may_take() -> None:
    assert switcher.step(unable(NOW_S - DEADLINE_S + 0.001), Tick(), NOW_S)[0].phase is Phase.ROBOT


def test_the_time_counts_from_the_beginning_of_the_stay() -> None:
    fresh = unable(NOW_S - 60.0, phase=Phase.TAKEOVER, charged_s=NOW_S - 0.1, epoch=5, last_epoch=5)
    assert switcher.step(fresh, Tick(), NOW_S)[0].phase is Phase.TAKEOVER


def test_a_robot_whose_output_is_silent_is_unable_too() -> None:
    silent = gate_report(Site.ROBOT, 3, robot_flows=False)
    robot, commands = switcher.step(robot_in(policy=HELD), GateReported(silent), NOW_S)
    assert not only(commands, Acting).outputs_flow
    later_s = NOW_S + DEADLINE_S + 0.010
    robot = replace(robot, situation=situation(Phase.ROBOT, later_s, gate=silent), link=good_link(later_s))
    robot, commands = switcher.step(replace(robot, stalls=Stalls(later_s - 0.010)), Tick(), later_s)
    assert (robot.phase, only(commands, Decided).verdict.reason) == (Phase.TO_CLOUD, "RobotUnable")


@pytest.mark.parametrize(
    "fault", [{"data_connected": False}, {"report": report(serves="")}], ids=["data", "not served"]
)
def test_a_robot_that_cannot_act_stays_when_the_cloud_cannot_either(fault: dict[str, Any]) -> None:
    robot = unable(NOW_S - 60.0, situation=situation(Phase.ROBOT, **fault))
    assert switcher.step(robot, Tick(), NOW_S)[0].phase is Phase.ROBOT


def test_a_robot_that_cannot_act_but_is_pinned_stays() -> None:
    robot, commands = switcher.step(unable(NOW_S - 60.0, pin=Wish(Site.ROBOT)), Tick(), NOW_S)
    assert robot.phase is Phase.ROBOT
    assert none_of(commands, Reopen)


def test_after_a_loss_with_a_dead_standby_the_cloud_returns_as_soon_as_it_is_back() -> None:
    story = in_cloud()
    story.robot_nodes.wake_s = NEVER_S
    story.run(1.0)
    for _ in range(3):  # flaps: the policy alone would hold the cloud down for seconds by now
        story.cut()
        story.run(0.6)
        story.cut(False)
        assert story.until_in(Phase.CLOUD) <= 0.5
        story.run(0.3)
    assert "RobotUnable" in {reason for _, reason in story.decisions()}


def test_a_cloud_as_silent_as_the_robot_is_woken_less_and_less_often() -> None:
    story = Story()
    story.robot_nodes.mute = story.cloud_nodes.mute = True
    story.run(40.0)
    tries_s = [at_s for at_s, decided in story.of(Decided) if decided.phase is Phase.TO_CLOUD]
    waits_s = [after - before for before, after in pairwise(tries_s)]
    assert all(after > 1.5 * before for before, after in pairwise(waits_s[:4]))
    assert len(tries_s) <= 6
    assert story.reason == "BothSilent"
    assert not any(acting.outputs_flow for at_s, acting in story.of(Acting) if at_s > NOW_S + 1.0), "inhibited, once"


def test_a_robot_whose_outputs_flow_again_forgets_that_both_were_silent() -> None:
    robot = robot_in(both_silent=True)
    assert not switcher.step(robot, Tick(), NOW_S)[0].both_silent


def test_a_silent_output_is_named_on_either_side() -> None:
    outputs = (OutputSpec("cmd_vel"), OutputSpec("arm"), OutputSpec("gripper"))
    silent = gate_report(Site.CLOUD, 4, cloud_flows=False, cloud_silent=(1, 2), robot_flows=False, robot_silent=(0,))
    robot, _ = switcher.step(robot_in(Phase.CLOUD, outputs=outputs), GateReported(silent), NOW_S)
    assert robot.decided.message == "The cloud's outputs arm, gripper are silent"
    later_s = NOW_S + SETTINGS.activation_deadline_s + 0.1
    _, commands = switcher.step(robot, GateReported(silent), later_s)
    assert only(commands, Acting).silent == ("cmd_vel",)


# -- a control process that gets its CPU in slices


def test_what_was_reported_is_judged_although_our_own_steps_are_late() -> None:
    stalled = robot_in(Phase.CLOUD, stepped_s=NOW_S - 0.060)
    robot, _ = switcher.step(stalled, GateReported(gate_report(Site.CLOUD, 4, cloud_flows=False)), NOW_S)
    assert (switcher.site(robot), robot.decided.reason) == (Site.ROBOT, "OutputSilent")


@pytest.mark.parametrize("gap_s", [0.055, 0.1, 0.2])
def test_a_starved_control_leaves_the_cloud_after_a_lease(gap_s: float) -> None:
    story = in_cloud(robot_hot=True)
    began_s = story.now_s
    while switcher.site(story.robot) is Site.CLOUD:
        assert story.now_s - began_s < 2.0
        story.control_runs = False
        story.run(gap_s)
        story.control_runs = True
        story.tell(Tick())
        story.run(0.010)
    assert story.switches()[0].verdict.reason == "ControlStarved"
    assert story.now_s - began_s <= SETTINGS.lease_s + 3 * (gap_s + 0.010)


def test_a_stall_of_control_is_no_silence_of_the_collector() -> None:
    """The reports are waiting in the inbox: an inhibit of a millisecond would be an emergency stop."""
    story = on_robot()
    story.control_runs = False
    story.run(0.4)
    story.control_runs = True
    story.run(1.0)
    assert all(acting.outputs_flow for _, acting in story.of(Acting))


def test_a_dead_collector_stops_the_driver_also_while_control_is_starved() -> None:
    story = on_robot()
    story.collector_runs = False
    for _ in range(20):
        story.control_runs = False
        story.run(0.060)
        story.control_runs = True
        story.run(0.010)
    assert not story.of(Acting)[-1][1].outputs_flow
