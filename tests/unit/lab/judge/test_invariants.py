"""Each broken promise is found and told in a sentence with its time and figures; a calm run breaks none."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload_lab.judge.invariants import Violation, gap_limit_ms, violations
from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Arrival, Ending, PlacementChange, Record, Recording
from tests.unit.lab.judge.recordings import (
    RUN,
    START_S,
    calm_run,
    changed,
    inhibited,
    is_arrival,
    later,
    link,
    placement,
    recording,
    stay,
)

END = Ending(START_S + 20.0, collisions=0, stops=0, goal_reached=True)


def found(of: Recording) -> tuple[Violation, ...]:
    return violations(measure(of))


def only(of: Recording) -> Violation:
    [violation] = found(of)
    return violation


def test_a_calm_run_breaks_no_promise() -> None:
    assert found(recording(calm_run())) == ()


def test_the_gap_limit_is_detection_activation_one_period_and_a_margin() -> None:
    assert gap_limit_ms(recording([RUN])) == 90 + 250 + 50 + 200


def test_a_message_that_passes_twice_is_a_violation() -> None:
    def twice(record: Record) -> Record | list[Record]:
        if is_arrival(record, "cloud", 5.0, 5.02):
            assert isinstance(record, Arrival)
            return [record, later(record, 0.005)]
        return record

    violation = only(changed(calm_run(), twice))
    assert violation.kind == "Duplicate"
    assert violation.t_s == pytest.approx(5.009)
    assert violation.text == "1 message of /cmd_vel passed twice, the first, remote_controller#251, at 5.009 s."


def test_messages_out_of_order_are_a_violation() -> None:
    def late(record: Record) -> Record:
        return later(record, 0.05) if is_arrival(record, "cloud", 5.0, 5.02) and isinstance(record, Arrival) else record

    assert only(changed(calm_run(), late)).text == (
        "1 message of /cmd_vel came after a later one of the same replica, the first, remote_controller#251, at "
        "5.054 s."
    )


def test_the_old_side_after_the_first_message_of_the_new_one_is_a_violation() -> None:
    extra = [arrival for arrival in stay("robot", 2.0, 2.2) if arrival.sequence > 40]
    violation = only(recording([*calm_run(), *extra]))
    assert violation.kind == "Interleaved"
    assert violation.text == (
        "4 messages of /cmd_vel from the robot passed after the cloud had taken over (epoch 2, first heard with "
        "remote_controller#101 at 2.004 s), the first, controller#41, at 2.004 s."
    )


def test_a_side_that_is_not_in_charge_is_heard_long_after_the_switch() -> None:
    extra = [arrival for arrival in stay("robot", 6.0, 6.1) if arrival.sequence > 40]
    assert [v.kind for v in found(recording([*calm_run(), *extra]))] == ["Interleaved"]


def test_the_old_side_may_pass_until_the_new_one_begins() -> None:
    extra = stay("robot", 2.0, 2.3)
    slow_cloud = changed(
        [*calm_run(), *extra], lambda record: None if is_arrival(record, "cloud", 2.0, 2.3) else record
    )
    assert found(slow_cloud) == ()


def test_an_announcement_may_lag_behind_the_messages() -> None:
    def announced_late(record: Record) -> Record:
        if isinstance(record, PlacementChange) and record.epoch > 1:
            return dataclasses.replace(record, t_s=record.t_s + 0.25)
        return record

    assert found(changed(calm_run(), announced_late)) == ()


def test_both_sides_at_once_are_a_violation_also_before_a_late_announcement() -> None:
    def announced_late(record: Record) -> Record:
        if isinstance(record, PlacementChange) and record.epoch == 2:
            return dataclasses.replace(record, t_s=record.t_s + 0.25)
        return record

    late = changed([*calm_run(), *stay("robot", 2.0, 2.2)], announced_late)
    assert "Interleaved" in [v.kind for v in found(late)]


def bounce(*, until_s: float, then: Sequence[Arrival] = ()) -> Recording:
    """The cloud takes over at 2 s and the robot at 2.19 s again; messages of the cloud pass until `until_s`."""
    arrivals = [*stay("robot", 0.0, 2.0), *stay("cloud", 2.0, until_s), *stay("robot", 2.25, 20.0), *then]
    placements = [placement(0.0, "robot", 1, "Start"), placement(2.0, "cloud", 2), placement(2.19, "robot", 3)]
    return recording([RUN, *arrivals, *placements, *link(20.0, [(2.1, 21.0)]), END])


def test_the_old_side_may_pass_until_the_new_one_begins_also_after_a_very_short_stay() -> None:
    assert found(bounce(until_s=2.24)) == ()


def test_the_old_side_after_the_first_message_of_the_new_one_is_a_violation_also_after_a_very_short_stay() -> None:
    violation = only(bounce(until_s=2.24, then=stay("cloud", 2.26, 2.27)))
    assert violation.text == (
        "1 message of /cmd_vel from the cloud passed after the robot had taken over (epoch 3, first heard with "
        "controller#46 at 2.254 s), the first, remote_controller#114, at 2.264 s."
    )


def test_a_side_that_was_heard_just_before_its_announcement_has_taken_over_then() -> None:
    early = [placement(0.0, "robot", 1, "Start"), placement(2.2, "cloud", 2)]
    arrivals = [*stay("robot", 0.0, 2.0), *stay("cloud", 2.0, 2.2), *stay("robot", 2.2, 2.25), *stay("cloud", 2.25, 20)]
    assert [v.kind for v in found(recording([RUN, *arrivals, *early, *link(20.0), END]))] == ["Interleaved"]


def called_off(*, epoch: int = 3, cloud: Sequence[tuple[float, float]] = ((5.1, 5.13),)) -> Recording:
    """The robot acts; at 5 s the cloud gets ready, at 5.13 s that is called off under an epoch."""
    spans = [0.0, *(t_s for span in cloud for t_s in span), 20.0]
    arrivals: list[Arrival] = []
    for start_s, end_s in zip(spans[::2], spans[1::2], strict=True):
        arrivals += stay("robot", start_s, end_s)
    for start_s, end_s in cloud:
        arrivals += stay("cloud", start_s, end_s)
    prepared = dataclasses.replace(placement(5.0, "robot", 1), phase="ToCloud")
    again = dataclasses.replace(prepared, t_s=prepared.t_s + 0.03, message="goals are handed over")
    placements = [placement(0.0, "robot", 1, "Start"), prepared, again, placement(5.13, "robot", epoch, "PulseSilent")]
    return recording([RUN, *arrivals, *placements, *link(20.0, [(5.1, 21.0)]), END])


def test_a_preparation_that_is_called_off_explains_one_stay_of_the_side_that_got_ready() -> None:
    assert found(called_off()) == ()


def test_a_preparation_that_is_called_off_explains_no_second_stay() -> None:
    violation = only(called_off(cloud=((5.1, 5.13), (5.16, 5.2))))
    assert (violation.kind, violation.t_s) == ("Interleaved", pytest.approx(5.164))


def test_a_preparation_explains_nothing_long_after_it_was_called_off() -> None:
    assert only(called_off(cloud=((5.5, 5.53),))).kind == "Interleaved"


def test_a_preparation_that_goes_on_under_its_epoch_explains_nothing() -> None:
    assert only(called_off(epoch=1)).kind == "Interleaved"


def stalled(*, cloud: Sequence[tuple[float, float]] = ((5.1, 5.35),)) -> Recording:
    """The cloud gets ready at 5 s, passes from 5.1 s on; control stands still till 6.5 s; a lease later the robot."""
    prepared = dataclasses.replace(placement(5.0, "robot", 1), phase="ToCloud")
    said = [placement(6.5, "cloud", 2), placement(6.501, "robot", 3, "ControlStalled")]
    arrivals = [*stay("robot", 0.0, 5.1), *(a for start_s, end_s in cloud for a in stay("cloud", start_s, end_s))]
    arrivals += stay("robot", 5.4, 20.0)
    return recording([RUN, placement(0.0, "robot", 1, "Start"), prepared, *said, *arrivals, *link(20.0), END])


def test_a_control_that_stands_still_at_the_changeover_explains_what_passed_until_its_lease_was_over() -> None:
    assert found(stalled()) == ()


def test_a_control_that_stands_still_at_the_changeover_explains_nothing_after_its_lease() -> None:
    violation = only(stalled(cloud=((5.1, 5.35), (5.6, 5.62))))
    assert (violation.kind, violation.t_s) == ("Interleaved", pytest.approx(5.604))


def fallen_back(*, announced: bool = True, cloud: Sequence[Arrival] = ()) -> Recording:
    """The cloud acts from 2 s on; control stands still at 8 s, the robot passes from 8.3 s on and is named at 9.5 s."""
    said = [placement(0.0, "robot", 1, "Start"), placement(2.0, "cloud", 2)]
    said += [placement(9.5, "robot", 3, "ControlStalled")] * announced
    arrivals = [*stay("robot", 0.0, 2.0), *stay("cloud", 2.0, 8.2), *cloud, *stay("robot", 8.3, 20.0)]
    return recording([RUN, *said, *arrivals, *link(20.0, [(8.1, 21.0)]), END])


def test_the_robot_may_be_announced_as_late_as_control_stands_still() -> None:
    assert found(fallen_back()) == ()


def test_a_robot_that_is_never_announced_is_a_violation() -> None:
    assert only(fallen_back(announced=False)).kind == "Interleaved"


def test_a_cloud_that_passes_beside_a_robot_that_is_not_announced_yet_is_a_violation() -> None:
    assert only(fallen_back(cloud=stay("cloud", 8.5, 8.52))).kind == "Interleaved"


def test_a_cloud_that_is_announced_later_than_a_lease_is_a_violation() -> None:
    placements = [placement(0.0, "robot", 1, "Start"), placement(2.4, "cloud", 2)]
    arrivals = [*stay("robot", 0.0, 2.0), *stay("cloud", 2.0, 20.0)]
    assert only(recording([RUN, *arrivals, *placements, *link(20.0), END])).kind == "Interleaved"


def test_a_message_older_than_allowed_is_a_violation() -> None:
    def older(record: Record) -> Record:
        if is_arrival(record, "cloud", 5.0, 5.06) and isinstance(record, Arrival):
            return dataclasses.replace(record, sent_t_s=record.t_s - 0.1 - 0.03 * (record.sequence - 250))
        return record

    assert only(changed(calm_run(), older)).text == (
        "2 messages of /cmd_vel from the cloud passed older than 150 ms, the first, remote_controller#252, at 5.024 s "
        "with 160.0 ms; the oldest had 190.0 ms."
    )


def test_what_the_robot_itself_delays_is_counted_but_breaks_no_promise_of_the_link() -> None:
    def older(record: Record) -> Record:
        if is_arrival(record, "robot", 11.0, 11.05) and isinstance(record, Arrival):
            return dataclasses.replace(record, sent_t_s=record.t_s - 0.2)
        return record

    measures = measure(changed(calm_run(), older))
    assert len(measures.streams["/cmd_vel"].stale) == 1
    assert violations(measures) == ()


def test_the_age_counts_up_to_the_passing_not_to_a_late_hearing() -> None:
    def late(record: Record) -> Record:
        if is_arrival(record, "cloud", 5.0, 5.02) and isinstance(record, Arrival):
            return dataclasses.replace(record, sent_t_s=record.t_s - 0.2, passed_t_s=record.t_s - 0.1)
        return record

    assert found(changed(calm_run(), late)) == ()


def test_a_silence_that_nothing_explains_is_a_violation() -> None:
    silent = changed(calm_run(), lambda record: None if is_arrival(record, "robot", 10.0, 11.0) else record)
    violation = only(silent)
    assert violation.text == (
        "/cmd_vel was silent for 1100 ms from 9.904 s until controller#221 came; 1100 ms of it without the driver "
        "being inhibited, more than the 590 ms that detection, activation and one period explain."
    )


def test_a_silence_until_the_end_is_a_violation() -> None:
    silent = changed(calm_run(), lambda record: None if is_arrival(record, "cloud", 18.0, 21.0) else record)
    assert only(silent).text.startswith("/cmd_vel was silent for 2016 ms from 17.984 s until the end of the run")


def test_a_silence_with_the_driver_inhibited_is_none() -> None:
    held = [*calm_run(), *inhibited(10.1, 11.0)]
    silent = changed(held, lambda record: None if is_arrival(record, "robot", 10.0, 11.0) else record)
    assert found(silent) == ()


def test_a_driver_that_is_inhibited_too_late_excuses_nothing() -> None:
    held = [*calm_run(), *inhibited(10.8, 11.0)]
    silent = changed(held, lambda record: None if is_arrival(record, "robot", 10.0, 11.0) else record)
    assert [v.kind for v in found(silent)] == ["Gap"]


def test_a_commanded_switch_that_loses_a_message_is_a_violation() -> None:
    lossy = changed(calm_run(), lambda record: None if is_arrival(record, "cloud", 2.1, 2.14) else record)
    assert only(lossy).text == (
        "The commanded switch from robot to cloud at 2.000 s lost 2 messages from the cloud over a good link."
    )


def test_what_the_robots_own_replica_loses_before_a_switch_is_no_loss_of_the_switch() -> None:
    lossy = changed(calm_run(), lambda record: None if is_arrival(record, "robot", 1.7, 1.78) else record)
    assert found(lossy) == ()
    assert measure(lossy).switches[0].lost > 0


def test_what_a_bad_link_loses_around_a_switch_is_no_violation() -> None:
    calm = [record for record in calm_run() if type(record).__name__ != "LinkSample"]
    lossy = changed(
        [*calm, *link(20.0, [(2.0, 2.2), (9.92, 14.0)])],
        lambda record: None if is_arrival(record, "cloud", 2.1, 2.14) else record,
    )
    assert found(lossy) == ()


def test_what_a_loop_that_the_agents_found_too_slow_loses_is_no_violation() -> None:
    def edited(record: Record) -> Record | None:
        if isinstance(record, PlacementChange) and record.epoch == 2:
            return dataclasses.replace(record, reason="LatencyTooHigh")
        return None if is_arrival(record, "cloud", 2.1, 2.14) else record

    assert found(changed(calm_run(), edited)) == ()


def test_an_epoch_that_does_not_grow_is_a_violation() -> None:
    def same_epoch(record: Record) -> Record:
        if isinstance(record, PlacementChange) and record.epoch == 3:
            return dataclasses.replace(record, epoch=2)
        return record

    assert only(changed(calm_run(), same_epoch)).text == (
        "The switch from cloud to robot at 10.020 s went from epoch 2 to 2; every changeover must have a higher one."
    )


MISTAKE = "Input /camera/image never arrived in the cloud, the limit is 400 ms"


@pytest.mark.parametrize(
    ("reason", "message", "kinds"),
    [
        ("InputStale", MISTAKE, ["Unused"]),
        ("CloudNotReady", "The cloud's nodes did not get ready in time: detector is unknown there", ["Unused"]),
        ("InputStale", "Input /camera/image is 900 ms old in the cloud, the limit is 400 ms", []),
        ("HeartbeatLost", "No heartbeat from the cloud for 90 ms", []),
    ],
)
def test_a_cloud_that_a_mistake_kept_out_for_the_whole_run_is_a_violation_that_names_the_mistake(
    reason: str, message: str, kinds: list[str]
) -> None:
    change = dataclasses.replace(placement(1.0, "robot", 1, reason), message=message)
    run: list[Record] = [RUN, placement(0.0, "robot", 1, "Start"), change, *stay("robot", 0.0, 20.0), *link(20.0)]
    run.append(Ending(START_S + 20.0, collisions=0, stops=0, goal_reached=True))
    violated = found(recording(run))
    assert [violation.kind for violation in violated] == kinds
    assert all(message in violation.text for violation in violated)


def test_violations_come_in_the_order_of_time() -> None:
    extra = stay("robot", 2.0, 2.2)
    silent = changed([*calm_run(), *extra], lambda record: None if is_arrival(record, "robot", 10.0, 11.0) else record)
    assert [violation.kind for violation in found(silent)] == ["Interleaved", "Gap"]


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.floats(0, 20), st.sampled_from(["robot", "cloud"]), st.integers(0, 9)), max_size=30))
def test_any_recording_can_be_judged(events: list[tuple[float, str, int]]) -> None:
    records: list[Record] = [RUN]
    for t_s, site, number in events:
        side = "robot" if site == "robot" else "cloud"
        records += [
            Arrival("/cmd_vel", START_S + t_s, side, number, START_S + t_s - number / 30, side),  # type: ignore[arg-type]
            PlacementChange(START_S + t_s / 2, side, number, "Any", "any", float(number) or None),  # type: ignore[arg-type]
        ]
    assert all(violation.text.endswith(".") for violation in found(recording(records)))
