"""What the robot's control process knows of the cloud, and the checks that are not hard limits (limits.py).

Is a beat good, is the loop fast enough to be worth it, and do the clocks agree?
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from robot_offload_core.fence.token import Site
from robot_offload_core.link import links
from robot_offload_core.link.links import Link
from robot_offload_core.link.policies import Fitness
from robot_offload_core.words.beats import Beat, CloudReport
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import InputSpec, OutputSpec, Settings


@dataclass(frozen=True)
class Situation:
    """What the robot's control process has heard, besides the link. Times on its steady clock, seconds.

    Attributes:
        report: newest report of the cloud.
        control_age_s: silence of the cloud's control when that report was sent.
        good_s: arrival of the newest good beat of this stay.
        pulse_s: when our pulse process last sent a beat.
        gate: newest report of the collector, at gate_s.
        data_connected, data_cloud, data_heard_s: see DataReported.
        data_s: when the data process reported them.
    """

    report: CloudReport | None = None
    control_age_s: float | None = None
    good_s: float | None = None
    pulse_s: float | None = None
    gate: GateReport | None = None
    gate_s: float | None = None
    data_connected: bool = False
    data_cloud: str = ""
    data_heard_s: float | None = None
    data_s: float | None = None


class Circumstances(NamedTuple):
    """The values against which the situation is judged.

    Attributes:
        incarnation: of the robot's control process.
        partner: incarnation of the cloud addressed; "" while the robot acts and addresses no cloud yet.
        epoch: under which the cloud acts.
        settings, inputs: from the configuration.
        stall_until_s: silence is not judged before this time (our own stall), see limits.cloud_fault.
        starved: our own stalls have followed each other for longer than a lease.
        outputs: from the configuration, in the collector's numbering.
        shape: of the configuration; "" if unknown.
    """

    incarnation: str
    partner: str
    epoch: int
    settings: Settings
    inputs: tuple[InputSpec, ...]
    stall_until_s: float = 0.0
    starved: bool = False
    outputs: tuple[OutputSpec, ...] = ()
    shape: str = ""


def is_good(beat: Beat, arrived_s: float, link: Link, frame: Circumstances) -> bool:
    """Return whether a beat proves that the cloud acts: current token, fresh echo, and it reports acting.

    Args:
        beat: of the cloud.
        arrived_s: when it arrived.
        link: to the cloud addressed.
        frame: with the epoch under which the cloud is to act, even while it only gets ready.
    """
    report = beat.body
    if not isinstance(report, CloudReport) or beat.echo is None or beat.echo.incarnation != frame.incarnation:
        return False
    return (
        beat.incarnation == link.peer
        and report.serves == frame.incarnation
        and report.epoch == frame.epoch
        and report.acting
        and arrived_s - beat.echo.sent_us / 1e6 <= frame.settings.echo_limit_s
    )


def fitness(link: Link, settings: Settings, now_s: float) -> Fitness:
    """Judge the loop latency by the thesis's rule: t_l + t_c_cloud <= t_c_robot + tolerance."""
    latency_s = links.latency_s(link, now_s, settings.beat_period_s)
    limit_s = settings.allowed_loop_s
    silent_s = float("inf") if link.heard_s is None else now_s - link.heard_s
    if latency_s > limit_s:
        shown = "unknown" if latency_s == float("inf") else f"{latency_s * 1e3:.0f} ms"
        message = f"Loop latency {shown} is over the limit of {limit_s * 1e3:.0f} ms"
        return Fitness(False, Reason.LATENCY_TOO_HIGH, message, latency_s, silent_s)
    return Fitness(True, Reason.LINK_GOOD, f"Loop latency {latency_s * 1e3:.0f} ms", latency_s, silent_s)


def clock_fault(link: Link, settings: Settings) -> Verdict | None:
    """Return a veto if the system clocks differ, because user nodes compare stamps; None if they agree."""
    excess_s = links.clock_excess_s(link)
    if excess_s <= settings.max_clock_offset_s:
        return None
    message = (
        f"The system clocks differ by at least {excess_s * 1e3:.0f} ms, the limit is "
        f"{settings.max_clock_offset_s * 1e3:.0f} ms; synchronise them (chrony, ptp)"
    )
    return Verdict(Site.ROBOT, Reason.CLOCK_OFFSET, message)
