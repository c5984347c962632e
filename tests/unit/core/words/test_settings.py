"""What a user sets: values that cannot work together are named before anything starts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.words.declared import SettingsError
from robot_offload_core.words.settings import LOOKS_S, STALL_LEAST_S, InputSpec, OutputSpec, Settings
from tests.unit.core.builders import many


def test_the_defaults_work_together() -> None:
    Settings().check()


def test_the_default_loss_timeout_is_no_multiple_of_the_beat_period() -> None:
    settings = Settings()
    beats = settings.loss_timeout_s / settings.beat_period_s
    assert abs(beats - round(beats)) > 0.1


@pytest.mark.parametrize(
    "changes",
    [
        {"beat_period_s": 0.0},
        {"loss_timeout_s": -0.090},
        {"lease_s": 0.0},
        {"max_command_age_s": 0.0},
        {"robot_period_s": 0.0},
        {"cloud_period_s": 0.0},
        {"activation_deadline_s": 0.0},
        {"beat_period_s": float("nan")},
        {"loss_timeout_s": 0.039},
        {"tolerance_s": -0.031},
        {"lease_s": 0.189},
        {"max_command_age_s": 0.080},
    ],
    ids=lambda changes: ",".join(f"{name}={value}" for name, value in changes.items()),
)
def test_a_value_that_cannot_work_is_named_first_in_the_message(changes: dict[str, Any]) -> None:
    with pytest.raises(SettingsError) as caught:
        replace(Settings(), **changes).check()
    name, advice = str(caught.value).split(": ", 1)
    assert [name] == list(changes)
    assert "must" in advice


def test_the_least_lease_is_loss_timeout_plus_loop_latency_plus_two_beats() -> None:
    settings = Settings()
    least_s = settings.loss_timeout_s + settings.allowed_loop_s + 2 * settings.beat_period_s
    replace(settings, lease_s=least_s).check()
    with pytest.raises(SettingsError, match=rf"^lease_s: must be at least {least_s:.3f}"):
        replace(settings, lease_s=least_s - 1e-4).check()


def test_the_allowed_loop_solves_the_latency_rule() -> None:
    settings = Settings(robot_period_s=0.100, cloud_period_s=0.020, tolerance_s=0.050)
    assert settings.allowed_loop_s + settings.cloud_period_s == pytest.approx(
        settings.robot_period_s + settings.tolerance_s
    )


def test_the_slower_period_is_that_of_the_slower_replica() -> None:
    assert Settings(robot_period_s=0.050, cloud_period_s=0.020).slower_period_s == 0.050
    assert Settings(robot_period_s=0.020, cloud_period_s=0.050).slower_period_s == 0.050


durations = st.floats(0.001, 1.0)
spans = st.floats(0.0, 3.0)


@many
@given(durations, spans, spans, spans, durations, durations, spans)
def test_settings_that_pass_the_check_keep_the_promises_of_the_protocol(
    beat_s: float, beats: float, spare_s: float, age_s: float, robot_s: float, cloud_s: float, tolerance_s: float
) -> None:
    loss_s = beats * beat_s
    lease_s = loss_s + robot_s + tolerance_s - cloud_s + 2 * beat_s + spare_s - 0.1
    settings = Settings(beat_s, loss_s, lease_s, age_s, robot_s, cloud_s, tolerance_s)
    try:
        settings.check()
    except SettingsError:
        return
    assert settings.loss_timeout_s >= 2 * settings.beat_period_s, "one lost beat is no loss"
    assert settings.lease_s >= settings.echo_limit_s + 2 * settings.beat_period_s - 1e-6, "losing beats ends no lease"
    assert settings.max_command_age_s > settings.allowed_loop_s, "what the slowest allowed loop brings passes"
    assert settings.drift_s > 0


# -- what is coupled to them

TURN_S, SLACK_S = 0.020, 0.010


@many
@given(st.floats(0.005, 1.0), st.floats(2.01, 10.0), st.floats(0.0, 0.5))
def test_what_is_derived_from_settings_keeps_its_order_at_any_beat_period(
    beat_s: float, loss_beats: float, more_s: float
) -> None:
    settings = Settings(beat_period_s=beat_s, loss_timeout_s=loss_beats * beat_s)
    least_s = settings.echo_limit_s + 2 * beat_s
    age_s = settings.allowed_loop_s + beat_s + 0.001
    settings = replace(settings, lease_s=least_s + more_s, max_command_age_s=age_s)
    settings.check()
    assert settings.stall_s > TURN_S + SLACK_S, "no turn of ours is a stall"
    assert settings.stall_s <= max(STALL_LEAST_S, settings.loss_timeout_s / 2), "a stall is noticed before it is a loss"
    assert settings.pause_s > TURN_S + SLACK_S, "no turn of the cloud is a pause"
    assert settings.pause_s < max(settings.lease_s, STALL_LEAST_S + 1e-9)
    assert settings.robot_live_s > settings.loss_timeout_s + beat_s, "a robot that is not lost is not replaced"
    assert settings.drift_s > 0.18 * settings.lease_s


def test_the_figures_at_the_default_beat_period_are_those_of_the_docs() -> None:
    settings = Settings()
    derived = (settings.stall_s, settings.pause_s, settings.robot_live_s)
    assert derived == pytest.approx((0.050, 0.150, 1.0))


# -- outputs and inputs


@pytest.mark.parametrize("rate_hz", [0.05, 0.5, 1.0, 1.3, 2.0, 20.0, 1000.0])
def test_three_periods_are_a_deadline_for_any_rate_that_is_allowed(rate_hz: float) -> None:
    output = OutputSpec("status", max(3 / rate_hz, 0.1), 1 / rate_hz)  # as the operator chooses it
    assert (output.problem(), output.too_tight()) == ("", "")


def test_a_deadline_within_the_period_is_refused() -> None:
    assert OutputSpec("cmd", 0.050, 0.050).problem() == "must exceed the period, 50 ms at 20 Hz"
    assert OutputSpec("plan", 0.0, 0.050).problem() == ""


def test_a_deadline_that_the_collector_cannot_keep_up_with_is_too_tight() -> None:
    assert "at least 60 ms" in OutputSpec("cmd", 0.002, 0.001).too_tight()
    assert OutputSpec("cmd", LOOKS_S, 0.001).too_tight() == ""
    assert OutputSpec("plan", 0.0).too_tight() == ""


def test_an_age_that_every_message_would_exceed_is_too_tight() -> None:
    assert "should exceed 80 ms" in InputSpec("scan", 0.080).too_tight(Settings())
    assert InputSpec("scan", 0.081).too_tight(Settings()) == ""
    assert InputSpec("map").too_tight(Settings()) == ""
