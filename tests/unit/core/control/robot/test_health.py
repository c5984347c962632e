"""The hard limits: each reason is given in exactly the situation that it names, and in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest

from robot_offload_core.control.robot import health, limits
from robot_offload_core.control.robot.health import Circumstances, Situation
from robot_offload_core.control.robot.limits import DATA_TIMEOUT_S, LIMITS, Basis
from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Link, Offset
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.settings import InputSpec
from tests.unit.core.builders import (
    EPOCHS,
    NOW_S,
    ROBOT,
    SCAN,
    SETTINGS,
    STRANGER,
    charge,
    cloud_beat,
    gate_report,
    good_link,
    situation,
)

LOSS_S = SETTINGS.loss_timeout_s
NUDGE_S = 0.001


@dataclass(frozen=True)
class World:
    """What the cloud is judged by. All is well unless changed."""

    acting: bool
    situation: Situation
    link: Link
    frame: Circumstances
    now_s: float = NOW_S

    def reason(self) -> str:
        """Of the first broken limit; "" when all hold."""
        found = limits.cloud_fault(self.situation, self.link, self.frame, self.now_s, acting=self.acting)
        if found is None:
            return ""
        assert found.site is Site.ROBOT
        assert found.message
        return found.reason


def world(acting: bool = True) -> World:
    phase = Phase.CLOUD if acting else Phase.ROBOT
    partner = cloud_beat().incarnation if acting else ""
    frame = Circumstances(ROBOT, partner, EPOCHS[phase][0], SETTINGS, (SCAN,), stall_until_s=0.0)
    return World(acting, situation(phase), good_link(), frame)


Change = Callable[[World], World]


def told(**changes: Any) -> Change:
    """The situation changed."""
    return lambda was: replace(was, situation=replace(was.situation, **changes))


def linked(**changes: Any) -> Change:
    """The link changed."""
    return lambda was: replace(was, link=replace(was.link, **changes))


def reported(**changes: Any) -> Change:
    """The cloud's report changed."""

    def change(was: World) -> World:
        assert was.situation.report is not None
        return told(report=replace(was.situation.report, **changes))(was)

    return change


def framed(**changes: Any) -> Change:
    """The frame changed."""
    return lambda was: replace(was, frame=was.frame._replace(**changes))


def silent(part: str, for_s: float) -> Change:
    """A time of the situation lies so far back."""
    return told(**{part: NOW_S - for_s})


def link_silent(part: str, for_s: float) -> Change:
    """A time of the link lies so far back."""
    return linked(**{part: NOW_S - for_s})


STALLED = framed(stall_until_s=NOW_S + 0.010)
ALWAYS = [
    ("PulseSilent", told(pulse_s=None)),
    ("PulseSilent", silent("pulse_s", LOSS_S + NUDGE_S)),
    ("NeverHeard", lambda was: replace(was, link=Link())),
    ("HeartbeatLost", link_silent("heard_s", LOSS_S + NUDGE_S)),
    ("CloudControlSilent", told(report=None)),
    ("CloudControlSilent", told(control_age_s=None)),
    ("CloudControlSilent", told(control_age_s=LOSS_S + NUDGE_S)),
    ("EchoStale", linked(echo_sent_s=None)),
    ("EchoStale", link_silent("echo_sent_s", SETTINGS.echo_limit_s + NUDGE_S)),
    ("DuplicateIdentity", reported(refused=ROBOT, serves=STRANGER)),
    ("NotServed", reported(serves="")),
    ("NotServed", reported(serves=STRANGER)),
    ("DataProcessSilent", told(data_s=None)),
    ("DataProcessSilent", silent("data_s", DATA_TIMEOUT_S + NUDGE_S)),
    ("DataDisconnected", told(data_connected=False)),
    ("DataSilent", told(data_heard_s=None)),
    ("DataSilent", silent("data_heard_s", DATA_TIMEOUT_S + NUDGE_S)),
    ("DataMismatch", told(data_cloud=STRANGER)),
    ("DataMismatch", told(data_cloud="")),
    ("DataUnheard", reported(data_age_us=-1)),
    ("DataUnheard", reported(data_age_us=round(DATA_TIMEOUT_S * 1e6) + 1)),
    ("CollectorSilent", told(gate=None)),
    ("CollectorSilent", told(gate_s=None)),
    ("CollectorSilent", silent("gate_s", SETTINGS.lease_s + NUDGE_S)),
    ("ConfigurationDiffers", lambda was: framed(shape="11111111")(reported(shape="22222222")(was))),
    ("InputsDiffer", reported(input_ages_us=())),
    ("InputsDiffer", reported(input_ages_us=(1_000, 1_000))),
    ("InputStale", reported(input_ages_us=(-1,))),
    ("InputStale", reported(input_ages_us=(300_001,))),
]
ONLY_ACTING = [
    ("CloudRestarted", lambda was: told(data_cloud=STRANGER)(linked(peer=STRANGER)(was))),
    ("CloudNotActing", silent("good_s", LOSS_S + NUDGE_S)),
    ("CloudNotActing", told(good_s=None)),
    ("CloudNotActing", reported(acting=False)),
    ("CloudNotActing", reported(epoch=5)),
    ("CloudNodesDown", reported(ready=False, acting=False)),
    ("OutputSilent", told(gate=gate_report(Site.CLOUD, 4, cloud_flows=False))),
    ("CollectorFellBack", told(gate=gate_report(Site.CLOUD, 4, fell_back=True))),
    ("ControlStarved", framed(stall_until_s=NOW_S + 0.010, starved=True)),
    ("ControlStalled", lambda was: silent("good_s", SETTINGS.lease_s + NUDGE_S)(STALLED(was))),
]  # fmt: skip


@pytest.mark.parametrize("acting", [True, False], ids=["acting", "wished for"])
def test_a_world_in_which_all_is_well_has_no_fault(acting: bool) -> None:
    assert world(acting).reason() == ""


@pytest.mark.parametrize("acting", [True, False], ids=["acting", "wished for"])
@pytest.mark.parametrize(("reason", "change"), ALWAYS, ids=[f"{i}-{case[0]}" for i, case in enumerate(ALWAYS)])
def test_a_broken_limit_is_named(reason: str, change: Change, acting: bool) -> None:
    assert change(world(acting)).reason() == reason


@pytest.mark.parametrize(("reason", "change"), ONLY_ACTING, ids=[case[0] for case in ONLY_ACTING])
def test_a_broken_limit_of_a_cloud_in_charge_is_named(reason: str, change: Change) -> None:
    assert change(world()).reason() == reason


@pytest.mark.parametrize(
    "change",
    [
        silent("good_s", 60.0),
        told(good_s=None),
        reported(ready=False),
        told(gate=gate_report(Site.ROBOT, 3, cloud_flows=False)),
        lambda was: told(data_cloud=STRANGER)(linked(peer=STRANGER)(was)),
    ],
    ids=["no good beat", "never a good beat", "nodes asleep", "no outputs", "a new incarnation"],
)
def test_what_only_a_cloud_in_charge_has_to_do_hinders_no_wish(change: Change) -> None:
    assert change(world(acting=False)).reason() == ""


@pytest.mark.parametrize(
    "change",
    [
        silent("pulse_s", LOSS_S - NUDGE_S),
        link_silent("heard_s", LOSS_S - NUDGE_S),
        told(control_age_s=LOSS_S - NUDGE_S),
        link_silent("echo_sent_s", SETTINGS.echo_limit_s - NUDGE_S),
        silent("data_s", DATA_TIMEOUT_S - NUDGE_S),
        silent("data_heard_s", DATA_TIMEOUT_S - NUDGE_S),
        reported(data_age_us=round(DATA_TIMEOUT_S * 1e6)),
        reported(data_age_us=0),
        silent("good_s", LOSS_S - NUDGE_S),
        silent("gate_s", SETTINGS.lease_s - NUDGE_S),
        reported(input_ages_us=(300_000,)),
        reported(input_ages_us=(0,)),
        reported(refused=STRANGER),
    ],
)
def test_what_stays_just_within_its_limit_is_no_fault(change: Change) -> None:
    assert change(world()).reason() == ""


def test_every_limit_has_a_case_here() -> None:
    stalls = {"ControlStalled", "ControlStarved"}
    assert {limit.reason.value for limit in LIMITS} | stalls == {case[0] for case in ALWAYS + ONLY_ACTING}


# -- which reason comes first


def test_a_refused_robot_reads_that_it_is_refused_although_nobody_echoes_it() -> None:
    refused = reported(refused=ROBOT, serves=STRANGER)(world(acting=False))
    assert linked(echo_sent_s=None)(refused).reason() == "DuplicateIdentity"


def test_a_dead_link_is_told_as_lost_beats_not_as_what_follows_from_it() -> None:
    lost = link_silent("heard_s", 1.0)(silent("good_s", 1.0)(silent("data_heard_s", 1.0)(world())))
    assert lost.reason() == "HeartbeatLost"


def test_our_own_dead_pulse_process_is_not_taken_for_a_dead_link() -> None:
    assert silent("pulse_s", 1.0)(link_silent("heard_s", 1.0)(world())).reason() == "PulseSilent"


# -- inputs


@pytest.mark.parametrize(("theirs", "ours"), [("", "11111111"), ("11111111", ""), ("11111111", "11111111")])
def test_a_configuration_of_the_same_shape_or_of_an_unknown_one_is_no_fault(theirs: str, ours: str) -> None:
    assert framed(shape=ours)(reported(shape=theirs)(world())).reason() == ""


def test_an_input_without_a_limit_is_not_judged_and_has_no_place_in_the_report() -> None:
    free = framed(inputs=(InputSpec("map"), SCAN))(world())
    assert free.reason() == ""
    assert reported(input_ages_us=(10, 10))(free).reason() == "InputsDiffer"


def test_the_message_of_a_stale_input_names_the_input_its_age_and_the_limit() -> None:
    both = framed(inputs=(SCAN, InputSpec("odom", 0.100)))(reported(input_ages_us=(1_000, 120_000))(world()))
    found = limits.cloud_fault(both.situation, both.link, both.frame, NOW_S, acting=True)
    assert found is not None
    assert found.message == "Input odom is 120 ms old in the cloud, the limit is 100 ms"


def test_the_message_of_an_input_that_never_arrived_says_so() -> None:
    missing = reported(input_ages_us=(-1,))(world())
    found = limits.cloud_fault(missing.situation, missing.link, missing.frame, NOW_S, acting=True)
    assert found is not None
    assert found.message == "Input scan never arrived in the cloud, the limit is 300 ms"


# -- the collector that fell back


def test_a_collector_that_fell_back_under_an_older_epoch_is_no_fault_of_the_new_one() -> None:
    older = gate_report(Site.CLOUD, 4, fell_back=True)
    assert framed(epoch=5)(reported(epoch=5)(told(gate=older)(world()))).reason() == ""


def test_a_collector_that_fell_back_before_control_ever_spoke_is_no_fault() -> None:
    unspoken = gate_report(Site.CLOUD, 4, fell_back=True, charge=None)
    assert told(gate=unspoken)(world()).reason() == ""


def test_a_collector_that_fell_back_hinders_a_wish_under_the_same_epoch() -> None:
    fallen = gate_report(Site.ROBOT, 3, fell_back=True, charge=charge(Site.ROBOT, 3))
    assert told(gate=fallen)(world(acting=False)).reason() == "CollectorFellBack"


# -- our own stall


SILENCES = {limit.reason.value for limit in LIMITS if limit.basis is Basis.SILENCE}


@pytest.mark.parametrize(("reason", "change"), ALWAYS, ids=[f"{i}-{case[0]}" for i, case in enumerate(ALWAYS)])
def test_after_a_stall_of_ours_silence_waits_for_what_is_still_unread(reason: str, change: Change) -> None:
    judged = reason not in SILENCES
    never_heard = change(world()).link.peer == ""  # so that the data session is another cloud's
    assert judged or never_heard or STALLED(change(world())).reason() == ""
    assert not judged or STALLED(change(world())).reason() == reason


@pytest.mark.parametrize(
    ("reason", "change"),
    [case for case in ONLY_ACTING if not case[0].startswith("Control")],
    ids=[case[0] for case in ONLY_ACTING if not case[0].startswith("Control")],
)
def test_what_was_reported_of_a_cloud_in_charge_is_judged_during_a_stall_of_ours(reason: str, change: Change) -> None:
    quiet = change(world()).situation.good_s != world().situation.good_s  # only the beats are silent
    assert STALLED(change(world())).reason() in ((reason,) if not quiet else ("", "ControlStalled"))


def test_a_stall_of_ours_hides_silence_for_no_longer_than_a_lease() -> None:
    assert STALLED(silent("good_s", SETTINGS.lease_s - NUDGE_S)(world())).reason() == ""
    assert STALLED(silent("good_s", SETTINGS.lease_s + NUDGE_S)(world())).reason() == "ControlStalled"


def test_silence_is_judged_again_when_the_grace_after_a_stall_is_over() -> None:
    late = framed(stall_until_s=NOW_S)(link_silent("heard_s", LOSS_S + NUDGE_S)(world()))
    assert late.reason() == "HeartbeatLost"


# -- fitness and clocks


def test_a_loop_within_the_rule_is_fit() -> None:
    fit = health.fitness(good_link(round_trip_s=0.059), SETTINGS, NOW_S)
    assert (fit.ok, fit.reason, fit.message) == (True, "LinkGood", "Loop latency 59 ms")


def test_a_loop_over_the_rule_is_not_and_the_message_gives_both_figures() -> None:
    fit = health.fitness(good_link(round_trip_s=0.061), SETTINGS, NOW_S)
    assert (fit.ok, fit.reason) == (False, "LatencyTooHigh")
    assert fit.message == "Loop latency 61 ms is over the limit of 60 ms"


def test_an_overdue_echo_makes_a_loop_unfit_before_it_is_lost() -> None:
    late = good_link(round_trip_s=0.010)
    assert health.fitness(late, SETTINGS, NOW_S + 0.085).ok
    assert not health.fitness(late, SETTINGS, NOW_S + 0.095).ok


def test_a_loop_that_was_never_closed_is_unfit() -> None:
    fit = health.fitness(Link(), SETTINGS, NOW_S)
    assert (fit.ok, fit.message) == (False, "Loop latency unknown is over the limit of 60 ms")


@pytest.mark.parametrize("wall_s", [0.029, -0.029, 0.0])
def test_clocks_that_may_agree_within_the_limit_are_no_fault(wall_s: float) -> None:
    link = Link(offset=Offset(0.0, wall_s, 0.010, NOW_S))
    assert health.clock_fault(link, SETTINGS) is None


@pytest.mark.parametrize("wall_s", [0.031, -0.031, 60.0])
def test_clocks_that_surely_differ_by_more_are_a_fault_that_says_what_to_do(wall_s: float) -> None:
    found = health.clock_fault(Link(offset=Offset(0.0, wall_s, 0.010, NOW_S)), SETTINGS)
    assert found is not None
    assert (found.site, found.reason) == (Site.ROBOT, "ClockOffset")
    assert "the limit is 20 ms; synchronise them" in found.message


def test_clocks_nothing_is_known_of_are_no_fault() -> None:
    assert health.clock_fault(Link(), SETTINGS) is None
