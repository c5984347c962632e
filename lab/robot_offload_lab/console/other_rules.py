"""What other switching rules would have done on the link that a console has shown, by the replay's policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from robot_offload.api.v1alpha1.switching import Switching
from robot_offload.console.live import Point
from robot_offload.errors import InputError
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay import study
from robot_offload_lab.replay.costs import Weights
from robot_offload_lab.replay.heartbeats import NEVER_US, Heartbeats
from robot_offload_lab.replay.named import POLICIES
from robot_offload_lab.replay.study import Replayed, StudiedLink

LEAST_S: Final = 5.0
"""Nothing can be judged on a stretch shorter than a hold-down."""
GAP_S: Final = 3.0
"""Between points further apart than this the link is not known, and counts as cut."""
_RULE: Final = ("latency", "profile", "heartbeatPeriod", "lossTimeout", "holdDown")


def judge(points: Sequence[Point], switching: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return what each rule would have done on this stretch; see `robot_offload.console.other_rules.Replay`."""
    settings = _settings(switching)
    link = StudiedLink(_beats(points, settings), settings, Weights())
    judged = [study.outcome(policy, link) for policy in POLICIES.values()]
    texts = {name: policy.text for name, policy in POLICIES.items()}
    return [
        _row(each, texts.get(each.policy, "the best with the whole stretch known")) for each in [*judged, link.best]
    ]


def _settings(switching: Mapping[str, Any]) -> Settings:
    try:
        rule = Switching.model_validate({name: switching[name] for name in _RULE if name in switching})
    except ValueError as error:
        raise InputError(f"other rules: this version cannot read spec.switching: {error}") from error
    return Settings(
        beat_period_s=rule.heartbeat_period_ms / 1e3,
        loss_timeout_s=rule.loss_timeout_ms / 1e3,
        lease_s=rule.lease_ms / 1e3,
        max_command_age_s=rule.max_command_age_ms / 1e3,
        robot_period_s=rule.latency.robot_period_ms / 1e3,
        cloud_period_s=rule.latency.cloud_period_ms / 1e3,
        tolerance_s=rule.latency.tolerance_ms / 1e3 + study.ROUNDING_S,
        hold_down_initial_s=rule.hold_down.initial_ms / 1e3,
        hold_down_max_s=rule.hold_down.max_ms / 1e3,
        flap_window_s=rule.hold_down.flap_window_ms / 1e3,
    )


def _beats(points: Sequence[Point], settings: Settings) -> Heartbeats:
    """Return the heartbeats of a link that stayed at each moment as last seen."""
    if not points or points[-1].t_s - points[0].t_s < LEAST_S:
        raise InputError(f"other rules: nothing can be judged before {LEAST_S:.0f} s of the link have been seen")
    times_s = np.array([point.t_s - points[0].t_s for point in points])
    rtts_us = np.array([NEVER_US if p.cut or p.latency_ms is None else round(p.latency_ms * 1e3) for p in points])
    period_us = round(settings.beat_period_s * 1e6)
    sent_us = np.arange(int(times_s[-1] * 1e6) // period_us, dtype=np.int64) * period_us
    seen = np.searchsorted(times_s, sent_us / 1e6, side="right") - 1
    known = (sent_us / 1e6 - times_s[seen] <= GAP_S) & (rtts_us[seen] != NEVER_US)
    in_order_us = np.maximum.accumulate(np.where(known, sent_us + np.where(known, rtts_us[seen], 0), 0))
    return Heartbeats("console", period_us, sent_us, np.where(known, in_order_us, NEVER_US))


def _row(each: Replayed, text: str) -> dict[str, str]:
    found = each.score
    return {
        "rule": f"{each.policy}: {text}",
        "cloud": f"{found.cloud_pct:.0f} %",
        "changes": str(found.switches),
        "exposed": f"{found.exposed_s:.1f} s",
        "cost": f"{found.cost:.1f}",
    }
