"""Settings that change while the robot runs, and a cloud that says that it is going."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.placement import CloudLeaving, Robot, SetPin, SetSettings, SwitchByHand, Wish
from robot_offload_core.control.robot.settling import meanwhile
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.declared import SettingsError
from robot_offload_core.words.events import Tick
from robot_offload_core.words.settings import Mode, Settings
from tests.unit.core.builders import CLOUD, NOW_S, SCAN, SETTINGS, STRANGER, few, good_link, many, robot_in, situation
from tests.unit.core.story import CLOUD_AHEAD_S, Story, in_cloud, on_robot

LONGER, SHORTER = replace(SETTINGS, lease_s=0.400), replace(SETTINGS, lease_s=0.200)
LEAVING = CloudLeaving(CLOUD, NOW_S + 60.0)


def after(robot: Robot, event: SetSettings | CloudLeaving | Tick, now_s: float = NOW_S) -> Robot:
    return switcher.step(robot, event, now_s)[0]


def asked(settings: Settings) -> SetSettings:
    return SetSettings(settings, (SCAN,))


# -- settings


@pytest.mark.parametrize("settings", [SHORTER, LONGER, replace(SETTINGS, mode=Mode.OBSERVE)])
def test_while_the_robot_acts_and_the_cloud_has_stopped_all_settings_hold_at_once(settings: Settings) -> None:
    robot = after(robot_in(), asked(settings))
    assert (robot.settings, robot.asked) == (settings, None)


def test_a_longer_lease_holds_at_once_while_the_cloud_acts() -> None:
    assert after(robot_in(Phase.CLOUD), asked(LONGER)).settings == LONGER


def test_a_shorter_lease_waits_while_the_cloud_acts_and_the_rest_does_not() -> None:
    robot = after(robot_in(Phase.CLOUD), asked(replace(SHORTER, loss_timeout_s=0.080, pin=Site.CLOUD)))
    assert robot.settings == replace(SETTINGS, loss_timeout_s=0.080, pin=Site.CLOUD)
    assert robot.asked is not None


def test_a_shorter_lease_waits_until_the_cloud_has_stopped_for_sure() -> None:
    robot = after(robot_in(clear_s=NOW_S + 0.100), asked(SHORTER))
    assert robot.settings.lease_s == SETTINGS.lease_s
    assert after(robot, Tick(), NOW_S + 0.101).settings.lease_s == SHORTER.lease_s


def test_what_is_asked_last_counts() -> None:
    robot = after(after(robot_in(Phase.CLOUD), asked(SHORTER)), asked(SETTINGS))
    assert robot.asked == SETTINGS
    assert robot.settings == SETTINGS


def test_an_agent_that_is_to_observe_brings_the_robot_into_charge_first() -> None:
    story = in_cloud()
    story.tell(asked(replace(SETTINGS, mode=Mode.OBSERVE)))
    story.until_in(Phase.ROBOT, limit_s=2.0)
    story.until(lambda: story.robot.settings.mode is Mode.OBSERVE, limit_s=2.0)
    story.cut()
    story.run(2.0)
    assert story.robot.phase is Phase.ROBOT


def test_a_loss_before_it_observes_is_still_a_loss() -> None:
    story = in_cloud()
    story.robot_nodes.able = False  # so that no commanded switch comes about
    story.tell(asked(replace(SETTINGS, mode=Mode.OBSERVE)))
    story.run(1.0)
    story.robot_nodes.able = True
    story.cut()
    story.until_in(Phase.ROBOT, limit_s=1.0)


def test_a_pin_of_the_resource_that_changes_is_obeyed_and_an_override_outweighs_it() -> None:
    story = in_cloud()
    story.tell(asked(replace(SETTINGS, pin=Site.ROBOT)))
    story.until_in(Phase.ROBOT, limit_s=2.0)
    assert story.reason == "PinnedToRobot"
    story.tell(SetPin(Wish(Site.CLOUD)))
    story.until_in(Phase.CLOUD, limit_s=5.0)


leases = st.floats(0.200, 1.0)


@few
@given(first=leases, second=leases, third=leases, wait_s=st.floats(0.0, 0.6))
def test_however_the_lease_changes_the_robot_never_thinks_the_cloud_stopped_before_it_has(
    first: float, second: float, third: float, wait_s: float
) -> None:
    story = Story(replace(SETTINGS, lease_s=first))
    story.cloud = replace(story.cloud, settings=replace(SETTINGS, lease_s=1.0))  # the cloud takes what is granted
    story.until_in(Phase.CLOUD)
    for lease_s in (second, third):
        story.tell(asked(replace(SETTINGS, lease_s=lease_s)))
        story.run(wait_s)
    story.up_cut = True  # the cloud hears nothing more, its lease runs out
    story.until(lambda: switcher.effects_site(story.robot, story.now_s) is Site.ROBOT)
    assert story.cloud.lease.end_s - CLOUD_AHEAD_S <= story.now_s


@many
@given(
    present=leases, lease_s=leases, loss_s=st.floats(0.040, 0.3), age_s=st.floats(0.05, 0.5), mode=st.sampled_from(Mode)
)
def test_what_holds_meanwhile_works_together_whenever_what_was_asked_for_does(
    present: float, lease_s: float, loss_s: float, age_s: float, mode: Mode
) -> None:
    wanted = Settings(lease_s=lease_s, loss_timeout_s=loss_s, max_command_age_s=age_s, mode=mode)
    try:
        wanted.check()
    except SettingsError:
        return
    meanwhile(Settings(lease_s=present), wanted).check()


# -- a cloud that is going


def test_the_robot_acts_before_a_cloud_is_gone_and_nothing_is_lost() -> None:
    story = in_cloud()
    story.tell(CloudLeaving(CLOUD, story.now_s + 60.0))
    story.until_in(Phase.ROBOT, limit_s=2.0)
    assert story.reason == "PodStopping"
    assert story.gap_s() <= SETTINGS.slower_period_s + 0.010 + 1e-6


@pytest.mark.parametrize("pin", [SetPin(Wish(Site.CLOUD)), asked(replace(SETTINGS, pin=Site.CLOUD))])
def test_no_pin_keeps_a_cloud_that_is_going(pin: SetPin | SetSettings) -> None:
    story = in_cloud()
    story.tell(pin)
    story.tell(CloudLeaving(CLOUD, story.now_s + 60.0))
    story.until_in(Phase.ROBOT, limit_s=2.0)


def test_a_cloud_that_is_going_is_not_chosen_again_until_the_time_is_over() -> None:
    story = on_robot()
    story.tell(SetPin(None))
    story.tell(CloudLeaving(CLOUD, story.now_s + 10.0))
    story.run(9.0)
    assert (story.robot.phase, story.reason) == (Phase.ROBOT, "PodStopping")
    assert story.until_in(Phase.CLOUD) > 0.5


def test_another_cloud_is_chosen_at_once() -> None:
    robot = robot_in(leaving=replace(LEAVING, cloud=STRANGER), pin=Wish(Site.CLOUD))
    assert after(robot, Tick()).phase is Phase.TO_CLOUD


def test_a_switch_by_hand_to_a_cloud_that_is_going_is_refused() -> None:
    robot, commands = switcher.step(robot_in(leaving=LEAVING), SwitchByHand(Site.CLOUD), NOW_S)
    assert "Refused (PodStopping)" in str(commands)
    assert robot.manual is None


def test_a_robot_that_cannot_act_uses_the_cloud_as_long_as_it_is_there() -> None:
    story = on_robot()
    story.tell(SetPin(None))
    story.tell(CloudLeaving(CLOUD, story.now_s + 60.0))
    story.robot_nodes.able = False
    story.until_in(Phase.CLOUD, limit_s=5.0)


def test_a_lost_cloud_that_is_going_is_a_loss_like_any_other() -> None:
    lost = robot_in(Phase.CLOUD, leaving=LEAVING, link=good_link(NOW_S - 1.0), situation=situation(Phase.CLOUD))
    assert after(lost, Tick()).phase is Phase.TAKEOVER
