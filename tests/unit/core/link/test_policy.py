"""The policy: it goes where the outlook goes, never into a bad link, and holds down after a flap."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site
from robot_offload_core.link import policies
from robot_offload_core.link.experts import EVERYBODY, NOBODY, Outlook, Spells
from robot_offload_core.link.policies import CLOUD_PREFERRED, PROVEN_S, Fitness, Policy
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import Settings
from tests.unit.core.builders import NOW_S, SETTINGS, many

GOOD = Fitness(True, Reason.LINK_GOOD, "Loop latency 10 ms", 0.010, 0.010)
UNEASY = Fitness(True, Reason.LINK_GOOD, "Loop latency 50 ms", 0.050, 0.010)
BAD = Fitness(False, Reason.LATENCY_TOO_HIGH, "Loop latency 200 ms is over the limit of 60 ms", 0.200, 0.010)
TICK_S = 0.010
FIRST_S, MOST_S = SETTINGS.hold_down_initial_s, SETTINGS.hold_down_max_s
STAYS = Policy(outlook=Outlook(ticked_s=NOW_S, clouds=EVERYBODY))
LEFT = Policy(outlook=Outlook(ticked_s=NOW_S, clouds=NOBODY))


class Robot:
    """Asks the policy every tick and moves when it says so; each beat is echoed at once when the link is good."""

    def __init__(self, site: Site = Site.ROBOT, settings: Settings = SETTINGS, policy: Policy = LEFT) -> None:
        self.site, self.settings, self.now_s = site, settings, NOW_S
        self.policy = policies.entered(policy, site, NOW_S)

    def ask(self, fitness: Fitness) -> Verdict:
        self.now_s += TICK_S
        sent_s = self.now_s - fitness.latency_s
        self.policy = policies.heard(self.policy, sent_s, fitness.latency_s, self.settings)
        self.policy, verdict = policies.decide(self.policy, self.site, fitness, self.settings, self.now_s)
        return verdict

    def until_moved(self, fitness: Fitness, limit_s: float = 60.0) -> float | None:
        """Seconds of this fitness until the policy says to move, and moves; None when not within `limit_s`."""
        for tick in range(1, round(limit_s / TICK_S) + 1):
            site = self.ask(fitness).site
            if site is not self.site:
                if site is Site.ROBOT:
                    self.policy = policies.lost(self.policy, self.settings, self.now_s)
                self.policy = policies.entered(self.policy, site, self.now_s)
                self.site = site
                return tick * TICK_S
        return None


# -- in the cloud


def test_on_a_good_link_it_stays_for_ever() -> None:
    assert Robot(Site.CLOUD, policy=STAYS).until_moved(GOOD) is None


def test_an_outlook_that_only_waits_ends_no_stay_on_a_good_link() -> None:
    robot = Robot(Site.CLOUD, policy=LEFT)
    assert robot.ask(GOOD) == CLOUD_PREFERRED


def test_a_slow_link_is_left_when_the_outlook_leaves_with_the_reason_of_the_link() -> None:
    robot = Robot(Site.CLOUD, policy=STAYS)
    while (verdict := robot.ask(BAD)).site is Site.CLOUD:
        assert verdict.reason == "CloudPreferred"
        assert verdict.message.startswith(f"{BAD.message}: borne for another")
    assert verdict == Verdict(Site.ROBOT, BAD.reason, BAD.message)


def test_without_anything_learnt_a_slow_link_is_borne_for_at_most_a_second() -> None:
    moved_s = Robot(Site.CLOUD, policy=STAYS).until_moved(BAD)
    assert moved_s is not None
    assert moved_s <= 1.0 + 2 * TICK_S


def test_a_link_that_gets_worse_is_left_before_it_is_bad_if_that_did_best_here() -> None:
    robot = Robot(Site.CLOUD, policy=LEFT)
    verdict = robot.ask(UNEASY)
    assert (verdict.site, verdict.reason) == (Site.ROBOT, "LinkUnsteady")
    assert "it gets worse" in verdict.message


def test_overdue_heartbeats_are_told_as_such() -> None:
    robot = Robot(Site.CLOUD, policy=LEFT)
    verdict = robot.ask(replace(GOOD, silent_s=0.050))
    assert (verdict.reason, verdict.message) == ("LinkUnsteady", "No heartbeat for 50 ms")


def test_the_message_tells_how_long_slow_spells_last_here() -> None:
    spells = Spells(True, NOW_S, bad_s=(0.1, 0.3, 0.2))
    robot = Robot(Site.CLOUD, policy=Policy(outlook=replace(STAYS.outlook, spells=spells)))
    assert "; slow spells here last 0.2 s in the median: borne for another" in robot.ask(BAD).message


# -- on the robot


def test_a_good_link_is_used_within_half_a_second() -> None:
    moved_s = Robot(policy=Policy()).until_moved(GOOD)
    assert moved_s is not None
    assert moved_s <= 0.5


def test_on_a_slow_link_the_robot_acts_for_ever_and_says_why() -> None:
    robot = Robot(policy=STAYS)
    assert robot.until_moved(BAD) is None
    assert robot.ask(BAD) == Verdict(Site.ROBOT, BAD.reason, BAD.message)


def test_the_message_says_how_long_outages_last_here_and_what_is_waited_for() -> None:
    spells = Spells(True, NOW_S, bad_s=(6.0, 5.0, 30.0))
    robot = Robot(policy=Policy(outlook=replace(LEFT.outlook, spells=spells)))
    robot.ask(GOOD)
    verdict = robot.ask(GOOD)
    assert (verdict.site, verdict.reason) == (Site.ROBOT, "Proving")
    assert verdict.message.startswith(
        "Link good for 0.0 s; outages here last 6.0 s in the median: waiting for another "
    )


def test_whatever_ended_a_stay_shows_for_a_beat_period() -> None:
    moved_s = Robot(policy=STAYS).until_moved(GOOD)
    assert moved_s == pytest.approx(SETTINGS.beat_period_s)


def held(hold_down_s: float) -> Robot:
    """On the robot since a moment ago, at the beginning of a hold-down of this length."""
    return Robot(policy=replace(STAYS, hold_down_s=hold_down_s, hold_until_s=NOW_S + hold_down_s))


def test_the_cloud_is_not_used_during_the_hold_down_and_the_message_says_how_long() -> None:
    robot = held(3.0)
    verdict = robot.ask(GOOD)
    assert (verdict.site, verdict.reason) == (Site.ROBOT, "HoldDown")
    assert verdict.message == "The link is back, hold-down for another 3.0 s"
    assert robot.until_moved(GOOD) == pytest.approx(3.0, abs=2 * TICK_S)


def test_a_link_that_was_good_for_long_ends_a_longer_hold_down() -> None:
    assert held(30.0).until_moved(GOOD) == pytest.approx(PROVEN_S, abs=2 * TICK_S)


def test_time_that_steps_back_counts_for_nothing() -> None:
    policy, verdict = policies.decide(Robot(Site.CLOUD, policy=STAYS).policy, Site.CLOUD, BAD, SETTINGS, NOW_S - 5.0)
    assert (policy.bad_s, verdict.site) == (0.0, Site.CLOUD)


# -- hold-down


def hold_downs(stays: list[tuple[Fitness, float]]) -> list[float]:
    """Hold-downs after losses that end stays in the cloud of this fitness and length."""
    policy, now_s, found = STAYS, NOW_S, []
    for fitness, stay_s in stays:
        policy = policies.entered(policy, Site.CLOUD, now_s)
        for _ in range(max(1, round(stay_s / TICK_S))):
            now_s += TICK_S
            policy, _ = policies.decide(policy, Site.CLOUD, fitness, SETTINGS, now_s)
        policy = policies.entered(policies.lost(policy, SETTINGS, now_s), Site.ROBOT, now_s)
        found.append(policy.hold_until_s - now_s)
        now_s = policy.hold_until_s
    return found


def test_the_hold_down_doubles_with_each_flap_up_to_its_limit() -> None:
    assert hold_downs([(GOOD, 0.5)] * 8) == pytest.approx([1, 2, 4, 8, 16, 30, 30, 30])


def test_each_stay_that_paid_halves_the_hold_down_until_none_is_left() -> None:
    assert hold_downs([(GOOD, 0.5)] * 3 + [(GOOD, 10.0)] * 4) == pytest.approx([1, 2, 4, 2, 1, 0, 0])


def test_a_stay_that_exposed_more_than_it_brought_is_a_flap_although_it_was_not_that_short() -> None:
    assert hold_downs([(BAD, 2.0)]) == pytest.approx([FIRST_S])


def test_a_stay_of_the_flap_window_is_no_flap() -> None:
    long_s, short_s = SETTINGS.flap_window_s + TICK_S, SETTINGS.flap_window_s - TICK_S
    assert hold_downs([(BAD, long_s), (BAD, short_s)]) == pytest.approx([0, FIRST_S])


def test_a_loss_without_a_stay_in_the_cloud_judges_none_and_a_stay_is_judged_once() -> None:
    policy = policies.lost(Policy(hold_down_s=4.0), SETTINGS, NOW_S)
    assert (policy.hold_down_s, policy.hold_until_s) == (4.0, NOW_S + 4.0)
    flapped = policies.lost(policies.entered(STAYS, Site.CLOUD, NOW_S), SETTINGS, NOW_S + 0.1)
    assert policies.lost(flapped, SETTINGS, NOW_S + 0.2).hold_down_s == flapped.hold_down_s == FIRST_S


@many
@given(st.lists(st.tuples(st.booleans(), st.floats(0.01, 3)), min_size=1, max_size=4))
def test_no_hold_down_leaves_its_limits(stays: list[tuple[bool, float]]) -> None:
    for hold_s in hold_downs([(GOOD if good else BAD, stay_s) for good, stay_s in stays]):
        assert hold_s == 0 or FIRST_S - 1e-6 <= hold_s <= MOST_S + 1e-6


# -- always


@pytest.mark.parametrize("site", Site)
@pytest.mark.parametrize("fitness", [GOOD, BAD])
def test_who_prefers_the_robot_is_on_the_robot(site: Site, fitness: Fitness) -> None:
    robot = Robot(site, replace(SETTINGS, prefer=Site.ROBOT), STAYS)
    for _ in range(100):
        verdict = robot.ask(fitness)
        assert (verdict.site, verdict.reason) == (Site.ROBOT, "RobotPreferred")


@many
@given(st.lists(st.tuples(st.sampled_from([GOOD, UNEASY, BAD]), st.floats(0, 2)), max_size=40), st.sampled_from(Site))
def test_every_verdict_has_a_reason_and_a_message_and_a_slow_link_never_calls_for_the_cloud(
    answers: list[tuple[Fitness, float]], site: Site
) -> None:
    policy, now_s = policies.entered(STAYS, site, NOW_S), NOW_S
    for fitness, wait_s in answers:
        now_s += wait_s
        policy, verdict = policies.decide(policy, site, fitness, SETTINGS, now_s)
        assert verdict.reason.isidentifier()
        assert verdict.message
        assert fitness.ok or verdict.site is Site.ROBOT or site is Site.CLOUD
