"""Commanded changeovers: make before break both ways, called off without ever releasing the old side."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from robot_offload_core.collector import gate as collectors
from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.changeovers import PREPARE_EXTRA_S, REPORT_BEATS, RETRY_MAX_S
from robot_offload_core.control.robot.placement import (
    CloudLeaving,
    GateReported,
    NodesReported,
    Permit,
    SetPin,
    SwitchByHand,
    Wish,
)
from robot_offload_core.fence.token import Site, presence
from robot_offload_core.words.beats import Permission
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import Acting, Tick
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.messages import Reopen, SetGate
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import OutputSpec, Settings
from tests.unit.core.builders import (
    BEAT_S,
    CLOUD,
    LEASE_US,
    NOW_S,
    ROBOT,
    SETTINGS,
    acting_report,
    charge,
    gate_report,
    none_of,
    only,
    robot_in,
    situation,
)
from tests.unit.core.story import NEVER_S, Story, in_cloud, on_robot

DEADLINE_S = SETTINGS.activation_deadline_s + PREPARE_EXTRA_S + REPORT_BEATS * BEAT_S
JITTER_S = 0.015
"""What the story's grid of time and the way over its link add to a period."""
ASKED_CLOUD, ASKED_ROBOT = SwitchByHand(Site.CLOUD), SwitchByHand(Site.ROBOT)


def runs_of(story: Story) -> list[tuple[Site, int]]:
    """(site, epoch) of what passed, one entry for each uninterrupted row."""
    found: list[tuple[Site, int]] = []
    for message in story.passed:
        if (message.site, message.epoch) not in found[-1:]:
            found.append((message.site, message.epoch))
    return found


def phases(story: Story) -> list[Phase]:
    """The phases that were told, one after the other."""
    told = [phase for phase, _ in story.decisions()]
    return told[:1] + [after for before, after in pairwise(told) if after is not before]


def holes(story: Story) -> int:
    """Sequences missing between the first and the last passed message of each epoch."""
    lost = 0
    for epoch in {message.epoch for message in story.passed}:
        sequences = [message.sequence for message in story.passed if message.epoch == epoch]
        lost += sequences[-1] - sequences[0] + 1 - len(sequences)
    return lost


# -- the whole way, one after the other


def test_to_the_cloud_and_back_each_side_is_ready_before_the_other_is_released() -> None:
    story = on_robot()
    story.tell(SetPin(None))
    story.until_in(Phase.CLOUD)
    story.run(1.0)
    story.hand(Site.ROBOT)
    story.until_in(Phase.ROBOT)
    story.run(1.0)
    assert phases(story) == [Phase.TO_CLOUD, Phase.CLOUD, Phase.TO_ROBOT, Phase.ROBOT]
    assert [site for site, _ in runs_of(story)] == [Site.ROBOT, Site.CLOUD, Site.ROBOT]
    assert story.gap_s() <= SETTINGS.slower_period_s + JITTER_S
    assert holes(story) == 0


def test_every_changeover_is_a_new_epoch_atomic_for_the_consumers() -> None:
    story = on_robot()
    for site in (Site.CLOUD, Site.ROBOT) * 3:
        story.tell(SetPin(Wish(site)))
        story.until_in(Phase.CLOUD if site is Site.CLOUD else Phase.ROBOT)
        story.run(0.5)
    epochs = [epoch for _, epoch in runs_of(story)]
    assert epochs == sorted(set(epochs))
    assert len(epochs) == 7


@pytest.mark.parametrize("site", Site)
def test_the_side_that_gets_ready_is_waited_for_while_the_other_one_acts(site: Site) -> None:
    story = in_cloud() if site is Site.ROBOT else on_robot()
    nodes = story.robot_nodes if site is Site.ROBOT else story.cloud_nodes
    nodes.wake_s = 0.4
    began_s = story.now_s
    story.tell(SetPin(Wish(site)))
    story.until_in(Phase.CLOUD if site is Site.CLOUD else Phase.ROBOT)
    assert story.now_s - began_s >= 0.4
    story.run(0.5)
    assert story.gap_s() <= SETTINGS.slower_period_s + JITTER_S


# -- towards the cloud, step by step


def test_a_preparation_of_the_cloud_grants_a_candidate_and_the_robot_acts_on() -> None:
    robot, commands = switcher.step(robot_in(), ASKED_CLOUD, NOW_S)
    assert (robot.phase, robot.epoch, robot.candidate, robot.last_epoch) == (Phase.TO_CLOUD, 3, 4, 4)
    assert robot.preparation is not None
    assert robot.preparation.deadline_s == pytest.approx(NOW_S + DEADLINE_S)
    assert only(commands, Permit).permission == Permission(4, True, CLOUD, LEASE_US, presence=True)
    assert only(commands, Acting) == Acting(acting=True, outputs_flow=True, in_charge=True)
    assert only(commands, SetGate).gate.current == charge(Site.ROBOT, 3)
    assert only(commands, SetGate).gate.next is None, "the cloud is not ready yet"
    assert only(commands, Decided).verdict.reason == "ByHand"
    assert not only(commands, Decided).switched


def ready_cloud(epoch: int = 4) -> object:
    return situation(Phase.TO_CLOUD, report=acting_report(epoch))


def test_the_collector_may_change_over_once_the_cloud_says_that_it_acts_under_the_candidate() -> None:
    robot = robot_in(Phase.TO_CLOUD, situation=ready_cloud())
    robot, commands = switcher.step(robot, Tick(), NOW_S)
    assert only(commands, SetGate).gate.next == charge(Site.CLOUD, 4)
    assert robot.preparation is not None
    assert robot.grant.offered


@pytest.mark.parametrize("epoch", [3, 5])
def test_a_cloud_that_acts_under_another_epoch_is_not_ready(epoch: int) -> None:
    robot, commands = switcher.step(robot_in(Phase.TO_CLOUD, situation=ready_cloud(epoch)), Tick(), NOW_S)
    assert only(commands, SetGate).gate.next is None
    assert robot.preparation is not None
    assert not robot.grant.offered


def test_the_cloud_is_in_charge_when_the_collector_says_that_it_has_changed_over() -> None:
    robot = robot_in(Phase.TO_CLOUD, situation=ready_cloud(), armed=True, offered=True, failures=3, retry_s=NOW_S + 9)
    robot, commands = switcher.step(robot, GateReported(gate_report(Site.CLOUD, 4)), NOW_S)
    assert (robot.phase, robot.epoch, robot.candidate) == (Phase.CLOUD, 4, 0)
    assert (robot.failures, robot.retry_s, robot.charged_s) == (0, 0.0, NOW_S)
    assert only(commands, Decided).switched
    assert only(commands, Permit).permission == Permission(4, True, CLOUD, LEASE_US, in_charge=True, presence=True)
    gate = Gate(robot.started_us, charge(Site.CLOUD, 4), None, NOW_S, presence=presence(ROBOT, CLOUD))
    assert only(commands, SetGate).gate == gate
    assert only(commands, Acting) == Acting(acting=False, outputs_flow=True, in_charge=False)


def test_a_report_of_the_old_charge_changes_nothing() -> None:
    robot = robot_in(Phase.TO_CLOUD)
    after, commands = switcher.step(robot, GateReported(gate_report(Site.ROBOT, 3)), NOW_S)
    assert after.phase is Phase.TO_CLOUD
    assert none_of(commands, Decided)


def test_a_cloud_that_is_not_ready_by_the_deadline_is_called_off() -> None:
    robot, commands = switcher.step(robot_in(Phase.TO_CLOUD, deadline_s=NOW_S), Tick(), NOW_S)
    assert (robot.phase, robot.candidate, robot.failures) == (Phase.ROBOT, 0, 1)
    assert only(commands, Decided).verdict.reason == "CloudNotReady"
    assert not only(commands, Decided).switched
    assert not only(commands, Permit).permission.granted
    assert none_of(commands, Reopen)


def test_after_calling_off_the_robot_acts_under_an_epoch_newer_than_the_candidate() -> None:
    robot, commands = switcher.step(robot_in(Phase.TO_CLOUD, deadline_s=NOW_S), Tick(), NOW_S)
    assert (robot.epoch, robot.last_epoch) == (5, 5)
    assert only(commands, SetGate).gate.current == charge(Site.ROBOT, 5)
    late = GateReported(gate_report(Site.CLOUD, 4))  # the collector had changed over just before it heard of that
    robot, _ = switcher.step(robot, late, NOW_S + 0.010)
    assert (robot.phase, robot.epoch) == (Phase.ROBOT, 5)


def test_a_hard_fault_of_the_cloud_calls_its_preparation_off_with_that_reason() -> None:
    robot = robot_in(Phase.TO_CLOUD, situation=situation(Phase.TO_CLOUD, data_connected=False))
    robot, commands = switcher.step(robot, Tick(), NOW_S)
    assert (robot.phase, only(commands, Decided).verdict.reason) == (Phase.ROBOT, "DataDisconnected")


@pytest.mark.parametrize(
    ("event", "reason"), [(ASKED_ROBOT, "ByHand"), (SetPin(Wish(Site.ROBOT)), "PinnedToRobot")], ids=["hand", "pin"]
)
def test_a_person_who_wants_the_robot_calls_the_preparation_of_the_cloud_off(
    event: SwitchByHand | SetPin, reason: str
) -> None:
    robot, commands = switcher.step(robot_in(Phase.TO_CLOUD), event, NOW_S)
    assert robot.phase is Phase.ROBOT
    assert only(commands, Decided).verdict.reason == reason


@pytest.mark.parametrize("phase", [Phase.TO_CLOUD, Phase.TO_ROBOT])
@pytest.mark.parametrize(("failures", "wait_s"), [(0, 1), (1, 2), (2, 4), (4, 16), (5, RETRY_MAX_S), (90, RETRY_MAX_S)])
def test_each_calling_off_in_a_row_doubles_the_wait_for_the_next_attempt(
    phase: Phase, failures: int, wait_s: float
) -> None:
    robot, _ = switcher.step(robot_in(phase, deadline_s=NOW_S, failures=failures), Tick(), NOW_S)
    assert (robot.failures, robot.retry_s) == (failures + 1, NOW_S + wait_s)


def test_a_cloud_that_never_wakes_never_interrupts_the_robot_and_is_tried_less_and_less_often() -> None:
    story = on_robot()
    story.cloud_nodes.wake_s = NEVER_S
    story.tell(SetPin(Wish(Site.CLOUD)))
    story.run(6.5)
    assert attempts(story, Phase.TO_CLOUD) == pytest.approx([1, 2], abs=0.05)
    assert {site for site, _ in runs_of(story)} == {Site.ROBOT}
    assert story.gap_s() <= SETTINGS.robot_period_s + 1e-6
    assert "CloudNotReady" in {reason for _, reason in story.decisions()}


def attempts(story: Story, phase: Phase) -> list[float]:
    """Waits between the end of an attempt and the beginning of the next."""
    began_s = [at_s for at_s, decided in story.of(Decided) if decided.phase is phase]
    return [after - before - DEADLINE_S for before, after in pairwise(began_s)]


def test_a_cloud_whose_output_never_comes_is_called_off_although_its_nodes_are_active() -> None:
    story = on_robot()
    story.cloud_nodes.mute = True
    story.tell(SetPin(Wish(Site.CLOUD)))
    story.run(DEADLINE_S + 0.2)
    assert story.decisions()[-1] == (Phase.ROBOT, "CloudNotReady")
    assert story.gap_s() <= SETTINGS.robot_period_s + 1e-6


def test_one_success_makes_the_next_retry_short_again() -> None:
    story = on_robot()
    story.cloud_nodes.wake_s = NEVER_S
    story.tell(SetPin(Wish(Site.CLOUD)))
    story.run(3.0)
    assert story.robot.failures == 2
    story.cloud_nodes.wake_s = 0.030
    story.until_in(Phase.CLOUD)
    assert (story.robot.failures, story.robot.retry_s) == (0, 0.0)


# -- towards the robot, step by step


def test_a_preparation_of_the_robot_wakes_it_and_renews_the_clouds_grant() -> None:
    robot, commands = switcher.step(robot_in(Phase.CLOUD), ASKED_ROBOT, NOW_S)
    assert (robot.phase, robot.epoch, robot.candidate, robot.last_epoch) == (Phase.TO_ROBOT, 4, 5, 5)
    assert only(commands, Permit).permission == Permission(4, True, CLOUD, LEASE_US, in_charge=True, presence=True)
    assert only(commands, Acting) == Acting(acting=True, outputs_flow=True, in_charge=False)
    assert only(commands, SetGate).gate.current == charge(Site.CLOUD, 4)
    assert only(commands, SetGate).gate.next is None


def test_the_collector_may_change_over_once_the_robots_nodes_are_ready() -> None:
    _, commands = switcher.step(robot_in(Phase.TO_ROBOT), NodesReported(True), NOW_S)
    assert only(commands, SetGate).gate.next == charge(Site.ROBOT, 5)
    assert only(commands, Permit).permission.granted, "the cloud acts until the collector has changed over"


def test_the_robot_is_in_charge_when_the_collector_says_so_and_only_then_the_grant_ends() -> None:
    robot = robot_in(Phase.TO_ROBOT, armed=True, nodes_ready=True)
    robot, commands = switcher.step(robot, GateReported(gate_report(Site.ROBOT, 5)), NOW_S)
    assert (robot.phase, robot.epoch, robot.charged_s) == (Phase.ROBOT, 5, NOW_S)
    assert only(commands, Permit).permission == Permission(5, False, CLOUD, LEASE_US, presence=True)
    assert only(commands, Decided).switched
    assert only(commands, Decided).silent_s is None, "nothing was lost"
    assert none_of(commands, Reopen)


def test_a_robot_that_is_not_ready_by_the_deadline_is_called_off_and_the_cloud_goes_on() -> None:
    robot, commands = switcher.step(robot_in(Phase.TO_ROBOT, deadline_s=NOW_S), Tick(), NOW_S)
    assert (robot.phase, robot.epoch, robot.candidate, robot.failures) == (Phase.CLOUD, 4, 0, 1)
    assert only(commands, Decided).verdict.reason == "RobotNotReady"
    assert only(commands, Permit).permission == Permission(4, True, CLOUD, LEASE_US, in_charge=True, presence=True)
    assert only(commands, SetGate).gate.next is None


def test_a_collector_that_changed_over_just_before_it_heard_of_the_calling_off_is_followed() -> None:
    robot, _ = switcher.step(robot_in(Phase.TO_ROBOT, deadline_s=NOW_S), Tick(), NOW_S)
    robot, commands = switcher.step(robot, GateReported(gate_report(Site.ROBOT, 5)), NOW_S + 0.010)
    assert (robot.phase, robot.epoch) == (Phase.ROBOT, 5)
    assert not only(commands, Permit).permission.granted


def test_a_robot_that_never_wakes_never_interrupts_the_cloud_and_is_tried_less_and_less_often() -> None:
    story = in_cloud()
    story.robot_nodes.wake_s = NEVER_S
    story.tell(SetPin(Wish(Site.ROBOT)))
    story.run(6.5)
    assert attempts(story, Phase.TO_ROBOT) == pytest.approx([1, 2], abs=0.05)
    assert runs_of(story) == [(Site.CLOUD, story.robot.epoch)]
    assert story.gap_s() <= SETTINGS.cloud_period_s + 1e-6
    assert holes(story) == 0
    permissions = {(p.permission.epoch, p.permission.granted) for _, p in story.of(Permit)}
    assert permissions == {(story.robot.epoch, True)}, "the old side was never released"


def test_the_cloud_lost_while_the_robot_wakes_puts_the_robot_in_charge_at_once() -> None:
    robot = robot_in(Phase.TO_ROBOT, situation=situation(Phase.TO_ROBOT, good_s=NOW_S - 0.095))
    robot, commands = switcher.step(robot, Tick(), NOW_S)
    assert (robot.phase, robot.epoch) == (Phase.TAKEOVER, 6)
    assert only(commands, Decided).switched


# -- when


def test_a_stay_is_not_shorter_than_the_least_dwell_if_only_the_policy_asks() -> None:
    settings = Settings(min_dwell_s=30.0)
    robot = robot_in(Phase.CLOUD, settings=replace(settings, prefer=Site.ROBOT), charged_s=NOW_S - 29.0)
    assert switcher.step(robot, Tick(), NOW_S)[0].phase is Phase.CLOUD
    assert switcher.step(replace(robot, charged_s=NOW_S - 31.0), Tick(), NOW_S)[0].phase is Phase.TO_ROBOT


def test_a_person_waits_for_no_dwell() -> None:
    robot = robot_in(Phase.CLOUD, settings=Settings(min_dwell_s=30.0), charged_s=NOW_S - 1.0)
    assert switcher.step(robot, ASKED_ROBOT, NOW_S)[0].phase is Phase.TO_ROBOT


def test_a_slow_loop_moves_to_the_robot_without_a_gap_and_back_when_it_is_fast_again() -> None:
    story = in_cloud()
    story.way_s = 0.050
    story.until_in(Phase.ROBOT)
    assert story.decisions()[0] == (Phase.TO_ROBOT, "LatencyTooHigh")
    story.run(2.0)
    story.way_s = 0.005
    story.until_in(Phase.CLOUD)
    assert story.gap_s() <= SETTINGS.slower_period_s + 0.050 + JITTER_S
    assert len(story.switches()) == 2


def test_who_prefers_the_robot_stays_there_for_good() -> None:
    story = Story(Settings(prefer=Site.ROBOT))
    story.run(5.0)
    assert story.switches() == []
    assert story.reason == "RobotPreferred"


def test_clocks_that_differ_move_the_robot_in_charge_and_keep_it_there() -> None:
    story = in_cloud()
    story.cloud_wall_error_s = 0.5
    story.until_in(Phase.ROBOT, limit_s=1.0)
    story.run(3.0)
    assert (story.robot.phase, story.reason) == (Phase.ROBOT, "ClockOffset")
    assert len(story.switches()) == 1


def test_the_decision_shown_is_the_one_that_was_taken() -> None:
    robot, commands = switcher.step(robot_in(Phase.CLOUD), ASKED_ROBOT, NOW_S)
    asked = Verdict(Site.ROBOT, Reason.BY_HAND, "The robot was asked for by hand")
    assert only(commands, Decided) == Decided(Site.CLOUD, 4, Phase.TO_ROBOT, asked, switched=False)
    assert robot.decided == asked


def test_with_outputs_that_are_not_rated_the_first_message_changes_over() -> None:
    story = on_robot()
    story.gate = replace(story.gate, outputs=(replace(story.gate.outputs[0], spec=OutputSpec("cmd_vel", 0.0)),))
    story.tell(SetPin(None))
    story.until_in(Phase.CLOUD)
    story.run(0.5)
    assert [site for site, _ in runs_of(story)] == [Site.ROBOT, Site.CLOUD]


# -- idle robots

IDLE = (OutputSpec("plan", 0.0),)


def test_a_pin_to_the_robot_is_obeyed_although_nothing_is_published() -> None:
    story = idle(on_robot())
    story.tell(SetPin(Wish(Site.CLOUD)))
    assert story.until_in(Phase.CLOUD) < 0.5
    story.tell(SetPin(Wish(Site.ROBOT)))
    assert story.until_in(Phase.ROBOT) < 0.5
    assert [d.verdict.reason for d in story.switches()] == ["PinnedToCloud", "PinnedToRobot"]


@pytest.mark.parametrize("reason", ["ClockOffset", "PodStopping"])
def test_a_veto_is_obeyed_although_nothing_is_published(reason: str) -> None:
    story = idle(on_robot())
    story.tell(SetPin(None))
    story.until_in(Phase.CLOUD)
    if reason == "ClockOffset":
        story.cloud_wall_error_s = 60.0
    else:
        story.tell(CloudLeaving(CLOUD, story.now_s + 60.0))
    assert story.until_in(Phase.ROBOT) < 0.5
    assert story.reason == reason


def idle(story: Story) -> Story:
    """Its nodes publish nothing while they have nothing to do, and no output is rated."""
    story.gate = collectors.start(IDLE, story.settings.max_command_age_s, story.settings.lease_s)
    story.robot_nodes.mute = story.cloud_nodes.mute = True
    return story


def test_a_robot_without_duplicated_nodes_never_prepares_a_changeover() -> None:
    robot, commands = switcher.step(robot_in(pin=Wish(Site.CLOUD)), NodesReported(True, duplicated=False), NOW_S)
    assert robot.phase is Phase.ROBOT
    assert none_of(commands, Decided) or only(commands, Decided).phase is Phase.ROBOT
    unable = robot_in(nodes_ready=False, fell_at_s=NOW_S - 60.0, duplicated=False)
    assert switcher.step(unable, Tick(), NOW_S)[0].phase is Phase.ROBOT


def test_a_slow_output_has_its_deadline_to_show_in_a_preparation() -> None:
    robot, _ = switcher.step(robot_in(outputs=(OutputSpec("status", 40.0),)), ASKED_CLOUD, NOW_S)
    assert robot.preparation is not None
    assert robot.preparation.deadline_s >= NOW_S + 40.0 + SETTINGS.activation_deadline_s
