"""Small recordings and policies for the tests of the replay."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings
from robot_offload_lab.links.recorded import Trace, load_trace, parse_trace
from robot_offload_lab.replay.costs import Weights
from robot_offload_lab.replay.heartbeats import Heartbeats, derive
from robot_offload_lab.replay.study import StudiedLink, case

ROOT = Path(__file__).parents[4]
EXAMPLES = {"corridor-wifi.txt": 0.020, "yard-4g.csv": 0.100}
"""Our made-up recordings with the tolerance that suits them, in seconds."""
RECORDED = {"wifi-static-robot.txt": 0.020, "4g-phone.txt": 0.100, "wifi-repeater-fibre.txt": 0.050}
"""Recordings of real links, where somebody keeps them beside the repository."""
PERIOD_S = 0.020


def text(*rtts_ms: float) -> Trace:
    """A recording measured back to back."""
    return parse_trace("\n".join(f"{rtt:g}" for rtt in rtts_ms), name="made")


def link(*phases: tuple[float, float | None]) -> Trace:
    """A CSV recording of phases (seconds, round trip in ms or None for no link), a request each 20 ms."""
    lines, t_ms = ["t_s,rtt_ms"], 0
    for length_s, rtt_ms in phases:
        for _ in range(round(length_s * 50)):
            lines.append(f"{t_ms / 1e3:.2f}," + ("" if rtt_ms is None else f"{rtt_ms:g}"))
            t_ms += 20
    return parse_trace("\n".join(lines), name="made")


def beats_of(trace: Trace) -> Heartbeats:
    """Its heartbeats, one each 20 ms."""
    return derive(trace, PERIOD_S)


def made_case(trace: Trace, tolerance_s: float = 0.030, weights: Weights | None = None) -> StudiedLink:
    """A case with the default periods: good enough up to 30 ms + the tolerance."""
    return case(trace, Settings(tolerance_s=tolerance_s), weights or Weights())


def example(name: str) -> StudiedLink:
    """One of our made-up recordings."""
    return made_case(load_trace(ROOT / "examples" / "traces" / name), EXAMPLES[name])


class Script:
    """A policy that acts as it was told, and keeps what it heard and when it was asked."""

    def __init__(self, plan: Sequence[tuple[float, Site]] = ()) -> None:
        self.plan = list(plan)
        self.echoes: list[tuple[float, float]] = []
        self.asked: list[float] = []

    def heard(self, sent_s: float, arrived_s: float) -> None:
        self.echoes.append((sent_s, arrived_s))

    def place(self, now_s: float) -> Site:
        self.asked.append(now_s)
        return next((site for at_s, site in reversed(self.plan) if at_s <= now_s), Site.ROBOT)
