"""What people want: by hand, by pin, by mode; refused with a reason, and never against safety."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from robot_offload_core.control.robot import readiness, requests, switcher
from robot_offload_core.control.robot.placement import (
    IN_CHARGE,
    Answer,
    Event,
    Handing,
    NodesReported,
    Permit,
    Robot,
    SetPin,
    SwitchByHand,
    Veto,
    Vetoed,
    Wish,
)
from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Link, Offset
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import Acting, Tick
from robot_offload_core.words.messages import Reopen
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import Mode, Settings
from tests.unit.core.builders import (
    NOW_S,
    SETTINGS,
    good_link,
    none_of,
    only,
    robot_in,
    situation,
)
from tests.unit.core.story import Story, in_cloud, on_robot

HOLD_S = SETTINGS.manual_hold_s
CLOCKS_DIFFER = Offset(0.0, 0.5, 0.001, NOW_S)


def after(robot: Robot, event: Event | None = None, now_s: float = NOW_S) -> Robot:
    return switcher.step(robot, Tick() if event is None else event, now_s)[0]


def answered(robot: Robot, site: Site) -> Answer:
    answer = only(switcher.step(robot, SwitchByHand(site, key=7), NOW_S)[1], Answer)
    assert isinstance(answer, Answer)
    assert answer.key == 7
    return answer


# -- by hand


@pytest.mark.parametrize(("phase", "site"), [(Phase.ROBOT, Site.CLOUD), (Phase.CLOUD, Site.ROBOT)])
def test_a_switch_by_hand_is_accepted_and_begins_at_once(phase: Phase, site: Site) -> None:
    robot = robot_in(phase)
    assert answered(robot, site) == Answer(7, True, f"Switching to the {site.value}")
    assert after(robot, SwitchByHand(site)).phase is (Phase.TO_CLOUD if site is Site.CLOUD else Phase.TO_ROBOT)


@pytest.mark.parametrize("phase", [Phase.ROBOT, Phase.CLOUD, Phase.TAKEOVER])
def test_asking_for_the_side_in_charge_is_accepted_and_changes_nothing(phase: Phase) -> None:
    site = IN_CHARGE[phase]
    robot = robot_in(phase)
    assert answered(robot, site) == Answer(7, True, f"The {site.value} is in charge already")
    assert (after(robot, SwitchByHand(site)).phase, after(robot, SwitchByHand(site)).epoch) == (phase, robot.epoch)


def test_asking_twice_is_the_same_as_asking_once() -> None:
    for phase, site in ((Phase.ROBOT, Site.CLOUD), (Phase.CLOUD, Site.ROBOT)):
        once = after(robot_in(phase), SwitchByHand(site))
        twice, commands = switcher.step(once, SwitchByHand(site), NOW_S)
        assert only(commands, Answer).accepted
        assert (twice.phase, twice.preparation) == (once.phase, once.preparation)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"settings": Settings(mode=Mode.OBSERVE)}, "Observe"),
        ({"pin": Wish(Site.ROBOT)}, "Pinned"),
        ({"settings": Settings(pin=Site.ROBOT)}, "Pinned"),
        ({"link": Link()}, "NeverHeard"),
        ({"link": good_link(NOW_S - 1.0)}, "HeartbeatLost"),
        ({"situation": situation(data_connected=False)}, "DataDisconnected"),
        ({"link": replace(good_link(), offset=CLOCKS_DIFFER)}, "ClockOffset"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_switch_to_the_cloud_is_refused_with_the_reason_and_leaves_no_wish(
    changes: dict[str, Any], reason: str
) -> None:
    robot = robot_in(**changes)
    answer = answered(robot, Site.CLOUD)
    assert not answer.accepted
    assert answer.message.startswith(f"Refused ({reason}): ")
    assert after(robot, SwitchByHand(Site.CLOUD)).manual is None
    assert after(robot, SwitchByHand(Site.CLOUD)).phase is Phase.ROBOT


def test_a_switch_to_the_robot_needs_no_link_and_is_refused_only_by_a_pin() -> None:
    assert answered(robot_in(Phase.CLOUD, link=good_link(NOW_S - 0.080)), Site.ROBOT).accepted
    assert not answered(robot_in(Phase.CLOUD, pin=Wish(Site.CLOUD)), Site.ROBOT).accepted


def test_a_switch_by_hand_to_where_the_pin_is_is_accepted() -> None:
    assert answered(robot_in(pin=Wish(Site.CLOUD)), Site.CLOUD).accepted


def test_a_wish_by_hand_outweighs_the_policy_for_its_time_and_no_longer() -> None:
    story = in_cloud()
    story.hand(Site.ROBOT)
    story.until_in(Phase.ROBOT)
    story.run(1.0)
    assert (story.robot.phase, story.reason) == (Phase.ROBOT, "ByHand")
    assert story.robot.manual is not None
    assert story.robot.manual.until_s == pytest.approx(story.now_s - 1.0 + HOLD_S, abs=0.2)
    story.robot = replace(story.robot, manual=Wish(Site.ROBOT, story.now_s))  # its time is over now
    assert story.until_in(Phase.CLOUD) <= 3.0


def test_a_later_wish_replaces_the_earlier() -> None:
    robot = after(robot_in(Phase.CLOUD), SwitchByHand(Site.ROBOT))
    assert after(robot, SwitchByHand(Site.CLOUD)).manual == Wish(Site.CLOUD, NOW_S + HOLD_S)


def test_by_hand_no_side_is_put_to_sleep_before_the_other_is_ready() -> None:
    story = in_cloud()
    story.robot_nodes.able = False
    assert story.hand(Site.ROBOT).accepted
    story.run(5.0)
    assert story.robot.phase in (Phase.CLOUD, Phase.TO_ROBOT)
    assert story.gap_s() <= SETTINGS.cloud_period_s + 1e-6


# -- pins


def wanted(**changes: Any) -> Robot:
    """One step of a robot in charge beside an able cloud that the policy wants to use soon, not yet."""
    return after(robot_in(**changes))


ROBOT, CLOUD = Wish(Site.ROBOT), Wish(Site.CLOUD)
IN_CLOUD, IN_ROBOT = Settings(pin=Site.CLOUD), Settings(pin=Site.ROBOT)


@pytest.mark.parametrize(
    ("changes", "moves"),
    [
        ({"pin": CLOUD}, True),
        ({"settings": IN_CLOUD}, True),
        ({"manual": CLOUD}, True),
        ({"pin": CLOUD, "settings": IN_ROBOT}, True),
        ({"pin": ROBOT, "settings": IN_CLOUD}, False),
        ({"settings": IN_ROBOT, "manual": CLOUD}, False),
        ({"settings": IN_CLOUD, "manual": ROBOT}, True),
        ({"pin": ROBOT, "manual": CLOUD}, False),
        ({"pin": CLOUD, "manual": ROBOT}, True),
        ({"pin": Wish(Site.ROBOT, NOW_S), "settings": IN_CLOUD}, True),
        ({"pin": Wish(Site.ROBOT, NOW_S + 1), "settings": IN_CLOUD}, False),
        ({"manual": Wish(Site.CLOUD, NOW_S)}, False),
        ({"pin": CLOUD, "link": replace(good_link(), offset=CLOCKS_DIFFER)}, False),
        ({"pin": CLOUD, "link": good_link(NOW_S - 1.0)}, False),
        ({"pin": CLOUD, "situation": situation(data_connected=False)}, False),
    ],
    ids=["pin", "resource", "hand", "pin > resource (cloud)", "pin > resource (robot)", "resource > hand (robot)",
         "resource > hand (cloud)", "pin > hand (robot)", "pin > hand (cloud)", "an expired pin is none",
         "a pin that still holds", "an expired wish is none", "clocks > pin", "lost beats > pin", "lost data > pin"],
)  # fmt: skip
def test_precedence_is_safety_then_pin_then_resource_then_hand_then_policy(
    changes: dict[str, Any], moves: bool
) -> None:
    assert wanted(**changes).phase is (Phase.TO_CLOUD if moves else Phase.ROBOT)


def test_a_pin_is_shown_as_the_reason() -> None:
    assert wanted(pin=CLOUD).decided.reason == "PinnedToCloud"
    robot, commands = switcher.step(robot_in(pin=CLOUD), SetPin(ROBOT), NOW_S)
    assert (robot.phase, only(commands, Decided).verdict.reason) == (Phase.ROBOT, "PinnedToRobot")


def test_a_cleared_pin_gives_the_choice_back() -> None:
    story = on_robot()
    story.tell(SetPin(None))
    assert story.until_in(Phase.CLOUD) <= 3.0


def test_pinned_to_the_cloud_the_robot_still_acts_when_the_cloud_is_lost() -> None:
    story = in_cloud()
    story.tell(SetPin(CLOUD))
    story.cut()
    story.until_in(Phase.ROBOT, limit_s=1.0)
    story.run(2.0)
    assert story.robot.phase is Phase.ROBOT
    assert story.reason == "HeartbeatLost"
    story.cut(False)
    assert story.until_in(Phase.CLOUD) <= 3.0


# -- Observe

OBSERVING = Settings(mode=Mode.OBSERVE)


def test_observing_it_decides_and_says_what_it_would_do_but_never_switches() -> None:
    story = Story(OBSERVING)
    story.run(3.0)
    assert (story.robot.phase, story.reason) == (Phase.ROBOT, "LinkGood")
    assert story.robot.decided.message.startswith("Observing only; would act on the cloud: ")
    story.cut()
    story.run(3.0)
    assert story.reason == "HeartbeatLost"
    assert story.robot.decided.message.startswith("Observing only; would act on the robot: ")
    assert story.switches() == []
    assert {permit.permission.granted for _, permit in story.of(Permit)} == {False}
    assert {(acting.acting, acting.in_charge) for _, acting in story.of(Acting)} == {(True, True)}
    assert story.of(Reopen) == []
    assert story.gap_s() <= SETTINGS.robot_period_s + 1e-6


@pytest.mark.parametrize("event", [SwitchByHand(Site.CLOUD), SetPin(CLOUD), NodesReported(False)])
def test_observing_nothing_makes_it_switch(event: Event) -> None:
    robot = robot_in(settings=replace(OBSERVING, pin=Site.CLOUD), fell_at_s=NOW_S - 60.0, nodes_ready=False)
    robot, commands = switcher.step(robot, event, NOW_S)
    assert (robot.phase, robot.epoch, robot.last_epoch) == (Phase.ROBOT, 3, 3)
    assert none_of(commands, Reopen)


# -- what is shown


def test_what_hinders_a_wished_for_cloud_is_shown_instead_of_the_wish() -> None:
    robot = robot_in(pin=CLOUD, situation=situation(data_connected=False), decided_s=NOW_S - 10)
    assert after(robot).decided.reason == "DataDisconnected"


def test_a_reason_that_changes_nothing_is_told_at_most_twice_a_second() -> None:
    robot = robot_in(pin=CLOUD, situation=situation(data_connected=False), decided_s=NOW_S - 0.48)
    assert none_of(switcher.step(robot, Tick(), NOW_S)[1], Decided)
    assert only(switcher.step(robot, Tick(), NOW_S + 0.030)[1], Decided).verdict.reason == "DataDisconnected"


def test_a_reason_that_stays_is_told_once() -> None:
    story = on_robot()
    story.run(3.0)
    assert story.decisions() == []


@pytest.mark.parametrize("phase", Phase)
def test_in_a_world_in_which_all_is_well_each_phase_goes_on(phase: Phase) -> None:
    assert after(robot_in(phase)).phase is phase


# -- vetoes of other processes

SECOND = Veto(Reason.SECOND_PUBLISHER, "/cmd_vel has another publisher: teleop")
OTHER_TYPE = Veto(Reason.TYPES_DIFFER, "cmd_vel is TwistStamped in the cloud, Twist on the robot")


def test_a_veto_of_another_process_puts_the_robot_in_charge_and_says_why() -> None:
    story = in_cloud()
    story.tell(Vetoed("collector", (SECOND,)))
    story.until_in(Phase.ROBOT, 1.0)
    assert (story.reason, story.robot.decided.message) == ("SecondPublisher", SECOND.message)
    story.run(2.0)
    assert story.robot.phase is Phase.ROBOT
    story.tell(Vetoed("collector"))
    story.until_in(Phase.CLOUD)


def test_a_limit_that_another_process_found_ends_a_stay_at_once() -> None:
    robot, commands = switcher.step(robot_in(Phase.CLOUD), Vetoed("data", (OTHER_TYPE,)), NOW_S)
    assert (switcher.site(robot), robot.decided.reason) == (Site.ROBOT, "TypesDiffer")
    assert only(commands, Decided).switched


def test_a_source_takes_back_its_own_vetoes_only() -> None:
    robot = after(after(robot_in(), Vetoed("collector", (SECOND,))), Vetoed("data", (OTHER_TYPE,)))
    assert [v.source for v in after(robot, Vetoed("collector")).vetoes] == ["data"]


def test_a_robot_that_cannot_act_stands_still_rather_than_to_break_a_veto() -> None:
    robot = robot_in(nodes_ready=False, fell_at_s=NOW_S - 60.0, vetoes=(Vetoed("collector", (SECOND,)),))
    assert after(robot).phase is Phase.ROBOT


def test_a_second_publisher_ends_a_stay_by_the_activation_deadline_though_the_robot_cannot_act() -> None:
    deadline_s = robot_in().settings.activation_deadline_s
    robot = after(robot_in(Phase.CLOUD, nodes_ready=False), Vetoed("collector", (SECOND,)))
    assert switcher.site(robot) is Site.CLOUD
    early = requests.limits(robot, NOW_S + deadline_s - 0.01, acting=True)
    late = requests.limits(robot, NOW_S + deadline_s, acting=True)
    assert (list(early), list(late)) == ([], [SECOND])
    robot, commands = switcher.step(replace(robot, forbidden_s=NOW_S - deadline_s), Tick(), NOW_S)
    assert (robot.phase, robot.decided.reason) == (Phase.TAKEOVER, "SecondPublisher")
    assert only(commands, Decided).switched


def test_the_time_that_a_second_publisher_is_given_ends_with_its_veto() -> None:
    robot = after(robot_in(Phase.CLOUD), Vetoed("collector", (SECOND,)))
    assert robot.forbidden_s == NOW_S
    assert after(robot, Vetoed("data", ())).forbidden_s == NOW_S
    assert after(robot, Vetoed("collector", ())).forbidden_s is None


def test_goals_buy_no_time_for_a_second_publisher() -> None:
    robot = robot_in(Phase.TO_ROBOT, handing=Handing(served=True, report=None))
    assert robot.preparation is not None
    preparation = replace(robot.preparation, patient_until_s=NOW_S + 1.0)
    for reason, arms in ((Reason.SECOND_PUBLISHER, True), (Reason.POD_STOPPING, False)):
        assert readiness.may_arm(robot, preparation, Verdict(Site.ROBOT, reason, ""), NOW_S) is arms


def test_a_strict_veto_stops_the_driver_whoever_acts() -> None:
    strict = Vetoed("collector", (replace(SECOND, stops=True),))
    for phase in (Phase.ROBOT, Phase.CLOUD):
        _, commands = switcher.step(robot_in(phase), strict, NOW_S)
        assert only(commands, Acting).stop == SECOND.message


DIFFER = Vetoed("parameters", (Veto(Reason.REPLICA_PARAMETERS_DIFFER, "Parameters differ: planner (speed)"),))


def test_replicas_with_other_parameters_hinder_the_policy_and_end_no_stay() -> None:
    for phase in (Phase.CLOUD, Phase.TO_ROBOT):
        assert after(robot_in(phase), DIFFER).phase is phase
    story = on_robot()
    story.tell(DIFFER)
    story.tell(SetPin(None))
    story.run(10.0)
    assert (story.robot.phase, story.reason) == (Phase.ROBOT, "ReplicaParametersDiffer")
    story.tell(Vetoed("parameters"))
    story.until_in(Phase.CLOUD)


def test_a_person_gets_the_cloud_although_the_parameters_differ_once_getting_ready_has_taken_its_time() -> None:
    story = on_robot()
    story.tell(DIFFER)
    story.tell(SetPin(None))
    story.tell(SwitchByHand(Site.CLOUD))
    story.run(story.robot.settings.preparing_s - 0.05)
    assert story.robot.phase is Phase.TO_CLOUD
    story.until_in(Phase.CLOUD)
    assert story.reason == "ByHand"


def test_a_robot_that_cannot_act_gets_the_cloud_although_the_parameters_differ() -> None:
    robot = robot_in(nodes_ready=False, fell_at_s=NOW_S - 60.0, vetoes=(DIFFER,))
    assert after(robot).phase is Phase.TO_CLOUD
