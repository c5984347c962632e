"""The rule: two patiences that learn, what they wait for, and the hold-down after a flap."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core import policy as policies
from robot_offload_core.policy import Fitness, Policy, Rule, Verdict
from robot_offload_core.settings import Settings
from robot_offload_core.token import Site
from tests.unit.core.builders import NOW_S, SETTINGS, many

GOOD = Fitness(True, "LinkGood", "Loop latency 10 ms")
BAD = Fitness(False, "LatencyTooHigh", "Loop latency 200 ms is over the limit of 60 ms")
RULE = Rule()
TICK_S = 0.010
BEAT_S = SETTINGS.beat_period_s
FIRST_S, MOST_S = SETTINGS.hold_down_initial_s, SETTINGS.hold_down_max_s


class Robot:
    """Asks the rule every tick and moves when it says so."""

    def __init__(self, site: Site = Site.ROBOT, settings: Settings = SETTINGS, policy: Policy | None = None) -> None:
        self.site, self.settings, self.now_s = site, settings, NOW_S
        self.policy = policies.entered(policy or Policy(), site, NOW_S)

    def ask(self, fitness: Fitness) -> Verdict:
        self.now_s += TICK_S
        self.policy, verdict = policies.decide(self.policy, self.site, fitness, self.settings, self.now_s)
        return verdict

    def move(self, site: Site) -> None:
        """A commanded changeover; leaving the cloud ends the stay."""
        if site is Site.ROBOT:
            self.policy = policies.lost(self.policy, self.settings, self.now_s)
        self.policy = policies.entered(self.policy, site, self.now_s)
        self.site = site

    def live(self, fitness: Fitness, duration_s: float) -> None:
        """Time goes on with this fitness; the rule is obeyed."""
        for _ in range(round(duration_s / TICK_S)):
            site = self.ask(fitness).site
            if site is not self.site:
                self.move(site)

    def until_moved(self, fitness: Fitness, limit_s: float = 60.0) -> float | None:
        """Seconds of this fitness until the rule says to move, and moves; None when it does not within `limit_s`."""
        for tick in range(1, round(limit_s / TICK_S) + 1):
            site = self.ask(fitness).site
            if site is not self.site:
                self.move(site)
                return tick * TICK_S
        return None


def about(duration_s: float) -> object:
    return pytest.approx(duration_s, abs=2 * TICK_S)


# -- in the cloud


def test_a_first_slow_link_is_borne_for_one_beat_period() -> None:
    assert Robot(Site.CLOUD).until_moved(BAD) == about(BEAT_S)


def test_the_reason_for_leaving_is_the_one_of_the_link() -> None:
    robot = Robot(Site.CLOUD)
    while (verdict := robot.ask(BAD)).site is Site.CLOUD:
        assert verdict.reason == "CloudPreferred"
        assert verdict.message.startswith(f"{BAD.message}, borne for another")
    assert verdict == Verdict(Site.ROBOT, BAD.reason, BAD.message)


def test_on_a_good_link_it_stays_for_ever() -> None:
    assert Robot(Site.CLOUD).until_moved(GOOD) is None


def impatient_leavings(robot: Robot, count: int) -> list[float]:
    """How long each of `count` slow phases was borne, when the link is good again right after the leaving."""
    borne = []
    for _ in range(count):
        assert robot.site is Site.CLOUD
        borne.append(robot.until_moved(BAD) or 0.0)
        assert robot.until_moved(GOOD) is not None
        robot.live(GOOD, 20.0)
    return borne


def test_patience_doubles_when_leaving_was_wrong() -> None:
    borne = impatient_leavings(Robot(Site.CLOUD), 5)
    first_s, most_s = RULE.patience_s, RULE.patience_max_s
    assert borne == [about(wait_s) for wait_s in (BEAT_S, first_s, 2 * first_s, most_s, most_s)]


def test_patience_halves_when_leaving_was_right() -> None:
    robot = Robot(Site.CLOUD, policy=Policy(patience_s=RULE.patience_max_s))
    assert robot.until_moved(BAD) == about(RULE.patience_max_s)
    robot.live(BAD, 10.0)
    assert robot.until_moved(GOOD) is not None
    assert robot.policy.patience_s == pytest.approx(RULE.patience_max_s / 2)


def test_short_slow_moments_far_apart_are_borne_for_ever_once_patient() -> None:
    robot = Robot(Site.CLOUD, policy=Policy(patience_s=0.2))
    for _ in range(20):
        robot.live(BAD, 0.1)
        robot.live(GOOD, 2.0)
    assert robot.site is Site.CLOUD


def test_slow_moments_close_together_add_up() -> None:
    robot = Robot(Site.CLOUD, policy=Policy(patience_s=0.2))
    for _ in range(5):
        robot.live(BAD, 0.1)
        robot.live(GOOD, 0.1)
        if robot.site is Site.ROBOT:
            return
    pytest.fail("half a second of a slow link within one second was borne")


# -- on the robot


def test_without_a_flap_before_a_good_link_is_used_after_one_beat_period() -> None:
    assert Robot().until_moved(GOOD) == about(BEAT_S)


def test_on_a_slow_link_the_robot_acts_for_ever_and_says_why() -> None:
    robot = Robot()
    assert robot.until_moved(BAD) is None
    assert robot.ask(BAD) == Verdict(Site.ROBOT, BAD.reason, BAD.message)


def held(hold_down_s: float) -> Robot:
    """On the robot since a moment ago, at the beginning of a hold-down of this length."""
    return Robot(policy=Policy(hold_down_s=hold_down_s, hold_until_s=NOW_S + hold_down_s))


def test_the_cloud_is_not_used_during_the_hold_down_and_the_message_says_how_long() -> None:
    robot = held(5.0)
    robot.live(GOOD, 2.0 - TICK_S)
    verdict = robot.ask(GOOD)
    assert (verdict.site, verdict.reason) == (Site.ROBOT, "HoldDown")
    assert verdict.message == "The link is back, hold-down for another 3.0 s"
    assert robot.until_moved(GOOD) == about(3.0)


def test_a_link_that_turns_slow_after_the_hold_down_has_to_prove_itself_again() -> None:
    robot = held(1.0)
    robot.live(BAD, 3.0)
    robot.live(GOOD, 0.9)
    verdict = robot.ask(GOOD)
    assert (verdict.site, verdict.reason) == (Site.ROBOT, "Proving")
    assert "another" in verdict.message
    robot.ask(BAD)
    assert robot.until_moved(GOOD) == about(1.0)


def test_a_link_that_is_never_good_for_a_whole_long_hold_down_is_used_all_the_same() -> None:
    robot = held(MOST_S)
    for _ in range(60):
        robot.live(GOOD, 3.0)
        if robot.site is Site.CLOUD:
            return
        robot.live(BAD, 0.1)
    pytest.fail("a link that is good for three of 3.1 seconds was never used")


def test_a_long_time_without_an_answer_is_reckoned_whole() -> None:
    policy = Policy(updated_s=NOW_S, hold_down_s=1.0)
    _, verdict = policies.decide(policy, Site.ROBOT, GOOD, SETTINGS, NOW_S + 1.5)
    assert verdict == Verdict(Site.CLOUD, "LinkGood", "The link has been good for long enough")


def test_the_first_question_of_all_finds_no_time_passed() -> None:
    assert policies.decide(Policy(), Site.ROBOT, GOOD, SETTINGS, NOW_S)[1].reason == "Proving"
    assert policies.decide(Policy(), Site.CLOUD, BAD, SETTINGS, NOW_S)[1].site is Site.CLOUD


def test_time_that_steps_back_counts_for_nothing() -> None:
    policy, verdict = policies.decide(Robot(Site.CLOUD).policy, Site.CLOUD, BAD, SETTINGS, NOW_S - 5.0)
    assert (policy.bad_s, verdict.site) == (0.0, Site.CLOUD)


# -- hold-down


def hold_downs(robot: Robot, stays: list[tuple[Fitness, float]]) -> list[float]:
    """Hold-downs after losses that end stays in the cloud of this fitness and length."""
    found = []
    for fitness, stay_s in stays:
        robot.policy = policies.entered(robot.policy, Site.CLOUD, robot.now_s)
        for _ in range(round(stay_s / TICK_S)):
            robot.now_s += TICK_S
            robot.policy, _ = policies.decide(robot.policy, Site.CLOUD, fitness, robot.settings, robot.now_s)
        robot.policy = policies.lost(robot.policy, robot.settings, robot.now_s)
        robot.policy = policies.entered(robot.policy, Site.ROBOT, robot.now_s)
        found.append(robot.policy.hold_until_s - robot.now_s)
        robot.now_s = robot.policy.hold_until_s
    return found


def test_the_hold_down_doubles_with_each_flap_up_to_its_limit() -> None:
    assert hold_downs(Robot(), [(GOOD, 0.5)] * 8) == pytest.approx([1, 2, 4, 8, 16, 30, 30, 30])


def test_each_stay_that_paid_halves_the_hold_down_until_none_is_left() -> None:
    robot = Robot()
    flaps, long_stays = [(GOOD, 0.5)] * 3, [(GOOD, 60.0)] * 4
    assert hold_downs(robot, flaps + long_stays) == pytest.approx([1, 2, 4, 2, 1, 0, 0])


def test_a_stay_that_exposed_more_than_it_brought_is_a_flap_although_it_was_not_that_short() -> None:
    assert hold_downs(Robot(), [(BAD, 2.0)]) == pytest.approx([FIRST_S])


def test_a_stay_of_the_flap_window_is_no_flap() -> None:
    long_s, short_s = SETTINGS.flap_window_s + TICK_S, SETTINGS.flap_window_s - TICK_S
    assert hold_downs(Robot(), [(BAD, long_s), (BAD, short_s)]) == pytest.approx([0, FIRST_S])


def test_a_loss_without_a_stay_in_the_cloud_judges_none() -> None:
    policy = policies.lost(Policy(hold_down_s=4.0), SETTINGS, NOW_S)
    assert (policy.hold_down_s, policy.hold_until_s) == (4.0, NOW_S + 4.0)


def test_a_stay_is_judged_once() -> None:
    robot = Robot()
    hold_downs(robot, [(GOOD, 0.5)])
    again = policies.lost(robot.policy, SETTINGS, robot.now_s)
    assert again.hold_down_s == robot.policy.hold_down_s


@many
@given(st.lists(st.tuples(st.booleans(), st.floats(0.01, 10)), min_size=1, max_size=6))
def test_no_hold_down_leaves_its_limits(stays: list[tuple[bool, float]]) -> None:
    for hold_s in hold_downs(Robot(), [(GOOD if good else BAD, stay_s) for good, stay_s in stays]):
        assert hold_s == 0 or FIRST_S - 1e-6 <= hold_s <= MOST_S + 1e-6


# -- always


@pytest.mark.parametrize("site", Site)
@pytest.mark.parametrize("fitness", [GOOD, BAD])
def test_who_prefers_the_robot_is_on_the_robot(site: Site, fitness: Fitness) -> None:
    robot = Robot(site, replace(SETTINGS, prefer=Site.ROBOT))
    for _ in range(500):
        verdict = robot.ask(fitness)
        assert (verdict.site, verdict.reason) == (Site.ROBOT, "RobotPreferred")


@many
@given(st.lists(st.tuples(st.booleans(), st.floats(0, 2)), max_size=40), st.sampled_from(Site))
def test_every_verdict_has_a_reason_and_a_message_and_a_slow_link_never_calls_for_the_cloud(
    answers: list[tuple[bool, float]], site: Site
) -> None:
    policy, now_s = policies.entered(Policy(), site, NOW_S), NOW_S
    for good, wait_s in answers:
        now_s += wait_s
        policy, verdict = policies.decide(policy, site, GOOD if good else BAD, SETTINGS, now_s)
        assert verdict.reason.isidentifier()
        assert verdict.message
        assert good or verdict.site is Site.ROBOT or site is Site.CLOUD
        assert 0 <= policy.patience_s <= RULE.patience_max_s
