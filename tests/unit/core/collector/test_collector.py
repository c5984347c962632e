"""The gate in front of the consumers: one side passes, changes are between two messages, and nothing goes back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from robot_offload_core.collector import gate as collectors
from robot_offload_core.collector.gate import PAUSE_GRACE_S, PAUSE_S
from robot_offload_core.collector.state import Collector
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.gates import Gate, GateReport, Passage, Ruling
from robot_offload_core.words.settings import OutputSpec
from tests.unit.core.builders import CLOUD, NOW_S, ROBOT, STRANGER, charge, us

OUTPUTS = (OutputSpec("cmd_vel", 0.150), OutputSpec("plan", 0.0))
RATED = (OutputSpec("cmd_vel", 0.150), OutputSpec("lights", 0.150))
MAX_AGE_S = 0.150
TIMEOUT_S = 0.250
STARTED_US = us(500.0)
CMD_VEL, OTHER = 0, 1


def gate(current: Charge, following: Charge | None = None, **changes: Any) -> Gate:
    return replace(Gate(STARTED_US, current, following), **changes)


def passing(
    current: Charge, following: Charge | None = None, *, outputs: tuple[OutputSpec, ...] = OUTPUTS, now_s: float = NOW_S
) -> Collector:
    """A collector to which control has just said this for the first time."""
    return collectors.set_gate(collectors.start(outputs, MAX_AGE_S, TIMEOUT_S), gate(current, following), now_s)


def sent(
    epoch: int, sequence: int, *, age_s: float = 0.010, cloud: str = CLOUD, robot: str = ROBOT, now_s: float = NOW_S
) -> Envelope:
    """A message of the cloud, `age_s` old at `now_s`."""
    return Envelope(Token(robot, epoch, cloud), sequence, us(now_s - age_s))


def offered(state: Collector, envelope: Envelope, index: int = CMD_VEL, now_s: float = NOW_S) -> str:
    """The reason given to a message of the cloud."""
    return collectors.offer_cloud(state, index, envelope, now_s)[1].reason


ROBOT_3, CLOUD_4, ROBOT_5 = charge(Site.ROBOT, 3), charge(Site.CLOUD, 4), charge(Site.ROBOT, 5)
CURRENT, IN_CHARGE = Passage(Ruling.CURRENT), Passage(Ruling.ROBOT_IN_CHARGE)


# -- one side


def test_before_control_has_spoken_the_robot_passes_and_the_cloud_does_not() -> None:
    state = collectors.start(OUTPUTS, MAX_AGE_S, TIMEOUT_S)
    assert collectors.offer_robot(state, CMD_VEL, 1, NOW_S)[1] == IN_CHARGE
    assert offered(state, sent(4, 1)) == "ControlSilent"
    late = collectors.tick(state, NOW_S + 60.0)
    assert collectors.offer_robot(late, CMD_VEL, 2, NOW_S + 60.0)[1] == IN_CHARGE


def test_while_the_robot_is_in_charge_only_the_robot_passes() -> None:
    state = passing(ROBOT_3)
    assert collectors.offer_robot(state, CMD_VEL, 1, NOW_S)[1] == IN_CHARGE
    assert offered(state, sent(3, 1)) == "ForeignToken"


def test_while_the_cloud_is_in_charge_only_the_cloud_passes() -> None:
    state = passing(CLOUD_4)
    assert collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)[1] == CURRENT
    assert collectors.offer_robot(state, CMD_VEL, 1, NOW_S)[1] == Passage(Ruling.CLOUD_IN_CHARGE)


@pytest.mark.parametrize(
    "foreign",
    [sent(3, 9), sent(5, 9), sent(4, 9, cloud=STRANGER), sent(4, 9, cloud=""), sent(4, 9, robot=STRANGER)],
    ids=["older epoch", "newer epoch", "another cloud", "no cloud", "another robot"],
)
def test_a_token_is_accepted_by_equality_only(foreign: Envelope) -> None:
    assert offered(passing(CLOUD_4), foreign) == "ForeignToken"
    assert offered(passing(ROBOT_3, CLOUD_4), foreign) == "ForeignToken"


@pytest.mark.parametrize(("sequence", "reason"), [(8, "Current"), (7, "Reordered"), (6, "Reordered"), (0, "Reordered")])
def test_under_one_token_only_ever_higher_sequences_pass(sequence: int, reason: str) -> None:
    state, _ = collectors.offer_cloud(passing(CLOUD_4), CMD_VEL, sent(4, 7), NOW_S)
    assert offered(state, sent(4, sequence)) == reason


def test_each_output_counts_for_itself() -> None:
    state, _ = collectors.offer_cloud(passing(CLOUD_4), CMD_VEL, sent(4, 700), NOW_S)
    assert offered(state, sent(4, 1), OTHER) == "Current"


@pytest.mark.parametrize(
    ("age_s", "reason"), [(0.0, "Current"), (0.149, "Current"), (0.151, "Stale"), (9.0, "Stale"), (-0.001, "Stale")]
)
def test_a_message_over_the_age_limit_or_from_the_future_is_stale(age_s: float, reason: str) -> None:
    assert offered(passing(CLOUD_4), sent(4, 1, age_s=age_s)) == reason


def test_a_message_whose_sender_had_heard_nothing_is_stale() -> None:
    assert offered(passing(CLOUD_4), replace(sent(4, 1), echo_us=0)) == "Stale"


# -- changing over


def test_the_old_side_passes_until_the_new_sides_first_message() -> None:
    state = passing(ROBOT_3, CLOUD_4)
    state, passage = collectors.offer_robot(state, CMD_VEL, 1, NOW_S)
    assert passage == IN_CHARGE
    state, passage = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    assert (passage, state.charge) == (Passage(Ruling.CHANGED_OVER), CLOUD_4)
    assert collectors.offer_robot(state, CMD_VEL, 2, NOW_S)[1] == Passage(Ruling.CLOUD_IN_CHARGE)
    assert offered(state, sent(4, 2)) == "Current"


def test_towards_the_robot_it_is_the_same() -> None:
    state = passing(CLOUD_4, ROBOT_5)
    state, passage = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    assert passage == CURRENT
    state, passage = collectors.offer_robot(state, CMD_VEL, 1, NOW_S)
    assert (passage, state.charge) == (Passage(Ruling.CHANGED_OVER), ROBOT_5)
    assert offered(state, sent(4, 2)) == "ForeignToken"


def test_it_changes_over_only_when_all_rated_outputs_of_the_new_side_flow() -> None:
    state = passing(ROBOT_3, CLOUD_4, outputs=RATED)
    state, passage = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    assert (passage, state.charge) == (Passage(Ruling.NOT_ALL_READY), ROBOT_3)
    assert collectors.offer_robot(state, CMD_VEL, 1, NOW_S)[1].passes
    state, passage = collectors.offer_cloud(state, OTHER, sent(4, 1), NOW_S)
    assert (passage, state.charge) == (Passage(Ruling.CHANGED_OVER, also=(CMD_VEL,)), CLOUD_4)


def test_it_changes_over_for_all_outputs_at_once() -> None:
    state = passing(ROBOT_3, CLOUD_4)
    state, _ = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    assert collectors.offer_robot(state, OTHER, 1, NOW_S)[1] == Passage(Ruling.CLOUD_IN_CHARGE)
    assert offered(state, sent(4, 1), OTHER) == "Current"


def test_an_output_that_fell_silent_again_is_waited_for_again() -> None:
    state = passing(ROBOT_3, CLOUD_4, outputs=RATED)
    state, _ = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    later_s = NOW_S + 0.151
    state = collectors.set_gate(state, gate(ROBOT_3, CLOUD_4), later_s)
    state, passage = collectors.offer_cloud(state, OTHER, sent(4, 1, now_s=later_s), later_s)
    assert passage.reason == "NotAllReady"
    assert collectors.offer_cloud(state, CMD_VEL, sent(4, 2, now_s=later_s), later_s)[1].reason == "ChangedOver"


def test_a_kept_message_that_grew_too_old_does_not_pass_with_the_changeover() -> None:
    state = passing(ROBOT_3, CLOUD_4)
    state, passage = collectors.offer_cloud(state, OTHER, sent(4, 1, age_s=0.140), NOW_S)
    assert passage.reason == "NotAllReady"
    later_s = NOW_S + 0.020
    _, passage = collectors.offer_cloud(state, CMD_VEL, sent(4, 1, now_s=later_s), later_s)
    assert passage == Passage(Ruling.CHANGED_OVER, also=())


def test_a_kept_message_that_is_young_enough_passes_with_the_changeover_and_never_twice() -> None:
    state, _ = collectors.offer_cloud(passing(ROBOT_3, CLOUD_4), OTHER, sent(4, 7), NOW_S)
    state, passage = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    assert passage == Passage(Ruling.CHANGED_OVER, also=(OTHER,))
    assert offered(state, sent(4, 7), OTHER) == "Reordered"
    assert offered(state, sent(4, 8), OTHER) == "Current"


@pytest.mark.parametrize("outputs", [(), (OutputSpec("plan", 0.0), OutputSpec("path", 0.0))], ids=["none", "unrated"])
@pytest.mark.parametrize(("current", "following"), [(ROBOT_3, CLOUD_4), (CLOUD_4, ROBOT_5)])
def test_without_rated_outputs_control_s_word_changes_over(
    outputs: tuple[OutputSpec, ...], current: Charge, following: Charge
) -> None:
    state = passing(current, outputs=outputs)
    assert state.charge == current
    state = collectors.set_gate(state, gate(current, following), NOW_S)
    assert (state.charge, state.next) == (following, None)
    again = collectors.set_gate(state, gate(current, following), NOW_S)  # control has not read our report yet
    assert again.charge == following


def test_an_idle_collector_that_fell_back_to_the_robot_is_not_led_back_by_the_old_word() -> None:
    state = collectors.tick(passing(CLOUD_4, outputs=()), NOW_S + TIMEOUT_S + 0.001)
    assert state.fell_back
    assert collectors.set_gate(state, gate(CLOUD_4, ROBOT_5), NOW_S + 1.0).fell_back


def test_a_process_that_pauses_again_and_again_hides_silence_for_no_longer_than_a_lease() -> None:
    state, now_s = passing(ROBOT_3, outputs=RATED), NOW_S
    state, _ = collectors.offer_robot(state, CMD_VEL, 1, now_s)
    while collectors.report(state, now_s).robot_flows and now_s < NOW_S + 5.0:
        now_s += PAUSE_S + 0.010
        state = collectors.turn(state, now_s)
    assert now_s - NOW_S <= RATED[CMD_VEL].deadline_s + TIMEOUT_S + 2 * (PAUSE_S + 0.010)


def test_a_robot_in_charge_has_one_deadline_for_its_first_message() -> None:
    slow = (OutputSpec("status", 3.0),)
    state = passing(ROBOT_3, outputs=slow)
    assert collectors.report(state, NOW_S + 2.9).robot_flows
    assert not collectors.report(state, NOW_S + 3.1).robot_flows


def test_a_restarted_collector_takes_its_own_restart_for_nobody_s_silence() -> None:
    state = collectors.start(RATED, MAX_AGE_S, TIMEOUT_S)
    state = collectors.resume(state, CLOUD_4, STARTED_US, fell_back=False, now_s=NOW_S)
    state = collectors.set_gate(state, gate(CLOUD_4), NOW_S + 0.020)
    report = collectors.report(state, NOW_S + 0.020)
    assert report.cloud_flows
    late_s = NOW_S + max(o.deadline_s for o in RATED) + 0.001
    assert not collectors.report(state, late_s).cloud_flows


def test_a_stale_message_of_the_new_side_is_no_sign_of_life() -> None:
    state, passage = collectors.offer_cloud(passing(ROBOT_3, CLOUD_4), CMD_VEL, sent(4, 1, age_s=0.2), NOW_S)
    assert (passage.reason, state.charge) == ("Stale", ROBOT_3)


def test_messages_of_the_new_side_in_the_wrong_order_are_dropped_while_they_are_kept() -> None:
    state, _ = collectors.offer_cloud(passing(ROBOT_3, CLOUD_4, outputs=RATED), CMD_VEL, sent(4, 7), NOW_S)
    assert offered(state, sent(4, 6)) == "Reordered"


# -- control's word


def test_it_never_goes_back_to_what_control_still_calls_current() -> None:
    state, _ = collectors.offer_cloud(passing(ROBOT_3, CLOUD_4), CMD_VEL, sent(4, 1), NOW_S)
    after = collectors.set_gate(state, gate(ROBOT_3, CLOUD_4), NOW_S + 0.010)
    assert (after.charge, after.next) == (CLOUD_4, None)


def test_a_sudden_change_named_by_control_takes_place_at_once() -> None:
    state = collectors.set_gate(passing(CLOUD_4), gate(ROBOT_5), NOW_S)
    assert collectors.offer_robot(state, CMD_VEL, 1, NOW_S)[1] == IN_CHARGE
    assert offered(state, sent(4, 99)) == "ForeignToken"


def test_a_preparation_that_is_called_off_cannot_change_over_any_more() -> None:
    state = collectors.set_gate(passing(ROBOT_3, CLOUD_4), gate(ROBOT_5), NOW_S)
    assert offered(state, sent(4, 1)) == "ForeignToken"


def test_a_new_candidate_starts_from_nothing() -> None:
    state, _ = collectors.offer_cloud(passing(ROBOT_3, CLOUD_4, outputs=RATED), CMD_VEL, sent(4, 1), NOW_S)
    state = collectors.set_gate(state, gate(ROBOT_5, charge(Site.CLOUD, 6)), NOW_S)
    assert offered(state, sent(6, 1), OTHER) == "NotAllReady"


def test_a_word_repeated_forgets_nothing_of_what_was_reached() -> None:
    state, _ = collectors.offer_cloud(passing(ROBOT_3, CLOUD_4, outputs=RATED), CMD_VEL, sent(4, 1), NOW_S)
    state = collectors.set_gate(state, gate(ROBOT_3, CLOUD_4), NOW_S + 0.010)
    assert offered(state, sent(4, 1), OTHER, NOW_S + 0.010) == "ChangedOver"


def test_a_restarted_control_outranks_the_one_before_although_its_epochs_start_again() -> None:
    first = Charge(Site.ROBOT, Token(STRANGER, 1, ""))
    state = collectors.set_gate(passing(CLOUD_4), gate(first, started_us=STARTED_US + 1), NOW_S)
    assert state.charge == first
    assert offered(state, sent(4, 99)) == "ForeignToken"


def test_late_words_of_the_control_before_are_ignored() -> None:
    state = collectors.set_gate(passing(ROBOT_3), gate(charge(Site.CLOUD, 99), started_us=STARTED_US - 1), NOW_S + 0.1)
    assert state == passing(ROBOT_3)


# -- control falls silent


def test_when_control_is_silent_for_longer_than_a_lease_the_robot_passes_and_the_cloud_does_not() -> None:
    late_s = NOW_S + TIMEOUT_S + 0.001
    state = collectors.tick(passing(CLOUD_4), late_s)
    assert state.fell_back
    assert collectors.offer_robot(state, CMD_VEL, 1, late_s)[1] == IN_CHARGE
    assert offered(state, sent(4, 1, now_s=late_s), now_s=late_s) == "ControlSilent"


def test_the_silence_is_noticed_by_the_message_itself_without_a_tick() -> None:
    late_s = NOW_S + TIMEOUT_S + 0.001
    assert offered(passing(CLOUD_4), sent(4, 1, now_s=late_s), now_s=late_s) == "ControlSilent"
    assert collectors.offer_robot(passing(CLOUD_4), CMD_VEL, 1, late_s)[1] == IN_CHARGE


def test_up_to_a_lease_of_silence_changes_nothing() -> None:
    assert collectors.tick(passing(CLOUD_4), NOW_S + TIMEOUT_S) == passing(CLOUD_4)


def test_a_word_that_waited_in_the_inbox_is_as_old_as_it_was_said() -> None:
    state = passing(ROBOT_3)
    state = collectors.set_gate(state, gate(CLOUD_4, said_s=NOW_S - 0.3), NOW_S)
    assert offered(state, sent(4, 1)) == "ControlSilent"


def test_a_word_from_the_future_is_taken_as_said_now() -> None:
    state = collectors.set_gate(passing(CLOUD_4), gate(CLOUD_4, said_s=NOW_S + 60.0), NOW_S)
    assert state.gate_s == NOW_S


def fallen(current: Charge = CLOUD_4, following: Charge | None = None) -> Collector:
    return collectors.tick(passing(current, following), NOW_S + 1.0)


def test_after_falling_back_the_cloud_passes_again_only_under_a_new_epoch() -> None:
    back_s = NOW_S + 1.0
    same = collectors.set_gate(fallen(), gate(CLOUD_4), back_s)
    assert offered(same, sent(4, 1, now_s=back_s), now_s=back_s) == "ControlSilent"
    anew = collectors.set_gate(same, gate(charge(Site.CLOUD, 6)), back_s)
    assert offered(anew, sent(6, 1, now_s=back_s), now_s=back_s) == "Current"


def test_after_falling_back_while_the_robot_was_in_charge_control_may_go_on() -> None:
    back_s = NOW_S + 1.0
    state = collectors.set_gate(fallen(ROBOT_3), gate(ROBOT_3, CLOUD_4), back_s)
    assert not state.fell_back
    assert offered(state, sent(4, 1, now_s=back_s), now_s=back_s) == "ChangedOver"


def test_falling_back_calls_a_preparation_off() -> None:
    assert fallen(ROBOT_3, CLOUD_4).next is None


# -- a restart of this process


def resumed(to: Charge = CLOUD_4, fell_back: bool = False) -> Collector:
    state = collectors.start(OUTPUTS, MAX_AGE_S, TIMEOUT_S)
    return collectors.resume(state, to, STARTED_US, fell_back, NOW_S)


def test_after_a_restart_the_robot_passes_at_once_if_it_was_in_charge() -> None:
    assert collectors.offer_robot(resumed(ROBOT_3), CMD_VEL, 1, NOW_S)[1] == IN_CHARGE
    assert collectors.offer_robot(resumed(CLOUD_4, fell_back=True), CMD_VEL, 1, NOW_S)[1] == IN_CHARGE


def test_after_a_restart_the_cloud_passes_only_when_control_has_spoken() -> None:
    assert offered(resumed(), sent(4, 9, age_s=-0.0), now_s=NOW_S) == "ControlSilent"
    state = collectors.set_gate(resumed(), gate(CLOUD_4), NOW_S + 0.020)
    assert offered(state, sent(4, 9, now_s=NOW_S + 0.020), now_s=NOW_S + 0.020) == "Current"


def test_after_a_restart_nothing_sent_before_it_passes_for_it_may_have_passed_already() -> None:
    state = collectors.set_gate(resumed(), gate(CLOUD_4), NOW_S + 0.020)
    assert offered(state, sent(4, 9, age_s=0.030, now_s=NOW_S + 0.020), now_s=NOW_S + 0.020) == "BeforeRestart"


def test_after_a_restart_what_was_left_behind_is_not_entered_again() -> None:
    state = collectors.set_gate(resumed(CLOUD_4), gate(ROBOT_3, CLOUD_4), NOW_S)
    assert state.charge == CLOUD_4


def test_after_a_restart_the_robot_passes_when_control_stays_silent() -> None:
    late_s = NOW_S + TIMEOUT_S + 0.001
    assert collectors.offer_robot(resumed(), CMD_VEL, 1, NOW_S)[1].reason == "CloudInCharge"
    assert collectors.offer_robot(resumed(), CMD_VEL, 1, late_s)[1] == IN_CHARGE


def test_a_restart_while_fallen_back_stays_fallen_back() -> None:
    state = collectors.set_gate(resumed(CLOUD_4, fell_back=True), gate(CLOUD_4), NOW_S)
    assert offered(state, sent(4, 9)) == "ControlSilent"


# -- effects that are not collected


def test_an_effect_is_admitted_from_the_holder_of_the_token_only() -> None:
    state = passing(CLOUD_4)
    assert collectors.admits_effect(state, CLOUD_4.token, NOW_S) == CURRENT
    for foreign in (ROBOT_3.token, Token(ROBOT, 4, STRANGER), Token(ROBOT, 5, CLOUD)):
        assert collectors.admits_effect(state, foreign, NOW_S) == Passage(Ruling.FOREIGN_TOKEN)


def test_an_effect_of_a_cloud_that_only_gets_ready_is_not_admitted() -> None:
    assert collectors.admits_effect(passing(ROBOT_3, CLOUD_4), CLOUD_4.token, NOW_S).reason == "ForeignToken"


@pytest.mark.parametrize(
    "state",
    [collectors.start(OUTPUTS, MAX_AGE_S, TIMEOUT_S), resumed(), fallen(), passing(CLOUD_4, now_s=NOW_S - 1.0)],
    ids=["never spoken", "restarted", "fallen back", "silent"],
)
def test_without_control_no_effect_of_the_cloud_is_admitted(state: Collector) -> None:
    assert collectors.admits_effect(state, CLOUD_4.token, NOW_S) == Passage(Ruling.CONTROL_SILENT)


# -- reports


def test_a_report_tells_whose_rated_outputs_flow() -> None:
    state = passing(CLOUD_4)
    silent = GateReport(CLOUD_4, False, False, False, robot_silent=(CMD_VEL,), cloud_silent=(CMD_VEL,))
    assert collectors.report(state, NOW_S) == silent
    state, _ = collectors.offer_cloud(state, CMD_VEL, sent(4, 1), NOW_S)
    assert collectors.report(state, NOW_S + 0.150).cloud_flows
    assert not collectors.report(state, NOW_S + 0.151).cloud_flows
    state, _ = collectors.offer_robot(state, CMD_VEL, 1, NOW_S)
    assert collectors.report(state, NOW_S).robot_flows


def test_messages_that_do_not_pass_because_they_are_foreign_or_stale_make_nothing_flow() -> None:
    state = passing(CLOUD_4)
    for envelope in (sent(5, 1), sent(4, 1, age_s=1.0)):
        state, _ = collectors.offer_cloud(state, CMD_VEL, envelope, NOW_S)
    assert not collectors.report(state, NOW_S).cloud_flows


def test_outputs_that_are_not_rated_are_not_waited_for() -> None:
    free = passing(CLOUD_4, outputs=(OutputSpec("plan", 0.0),))
    assert collectors.report(free, NOW_S) == GateReport(CLOUD_4, False, robot_flows=True, cloud_flows=True)


# -- a pause of our own


def test_after_a_pause_of_ours_an_output_is_not_called_silent_before_new_messages_could_come() -> None:
    state, _ = collectors.offer_cloud(passing(CLOUD_4), CMD_VEL, sent(4, 1), NOW_S)
    state = collectors.turn(state, NOW_S)
    state = collectors.turn(state, NOW_S + 0.4)
    assert collectors.report(state, NOW_S + 0.4).cloud_flows
    assert not collectors.report(state, NOW_S + 0.4 + PAUSE_GRACE_S).cloud_flows


def test_an_output_that_falls_silent_while_we_turn_is_called_silent() -> None:
    state, _ = collectors.offer_cloud(passing(CLOUD_4), CMD_VEL, sent(4, 1), NOW_S)
    for later_s in (0.0, 0.1, 0.2):
        state = collectors.turn(state, NOW_S + later_s)
    assert not collectors.report(state, NOW_S + 0.2).cloud_flows


def test_the_next_look_is_when_something_falls_silent() -> None:
    collector = passing(charge(Site.CLOUD, 3))
    assert collectors.next_deadline_s(collector, NOW_S) == NOW_S + OUTPUTS[CMD_VEL].deadline_s
    collector, _ = collectors.offer_cloud(collector, CMD_VEL, sent(3, 1, now_s=NOW_S + 0.02), NOW_S + 0.02)
    silent_s = NOW_S + 0.02 + OUTPUTS[CMD_VEL].deadline_s
    assert collectors.report(collector, silent_s).cloud_flows
    assert not collectors.report(collector, silent_s + 1e-6).cloud_flows
    deadlines = []
    now_s = NOW_S + 0.02
    while (now_s := collectors.next_deadline_s(collector, now_s)) < float("inf"):
        deadlines.append(now_s)
        now_s += 1e-6
    assert silent_s in deadlines
    assert deadlines[-1] == NOW_S + TIMEOUT_S
    assert not collectors.turn(collector, NOW_S + TIMEOUT_S).fell_back
    assert collectors.turn(collector, NOW_S + TIMEOUT_S + 1e-6).fell_back
