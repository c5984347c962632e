"""Whether the cloud may act: the worst of pulse, data, inputs and outputs (protocol section 1).

`cloud_fault` holds the hard limits: any of them ends a stay in the cloud at once and forbids a new one. `fitness` is
the soft question for the policy: is the loop fast enough to be worth it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from robot_offload_core import links
from robot_offload_core.beats import CloudReport
from robot_offload_core.collectors import GateReport
from robot_offload_core.links import Link
from robot_offload_core.policies import Fitness
from robot_offload_core.reasons import Reason, Verdict
from robot_offload_core.settings import InputSpec, Settings
from robot_offload_core.token import Site

DATA_TIMEOUT_S = 0.5
"""Silence of the data session's probes (ten a second) that means it is dead, while rated outputs are judged sooner."""


@dataclass(frozen=True)
class Situation:
    """What the robot's control process was told, besides the link. Times on its steady clock, seconds.

    Attributes:
        report: newest of the cloud; control_age_s: silence of its control when it was sent.
        good_s: arrival of the newest good beat of this stay.
        pulse_s: our pulse process last sent a beat.
        gate: newest report of the collector, at gate_s.
        data_connected, data_cloud, data_heard_s: see DataReported; data_s: when it was told.
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


@dataclass(frozen=True)
class Frame:
    """Against what the situation is judged.

    Attributes:
        incarnation: of the robot's control process.
        partner: incarnation of the cloud addressed; "" while the robot acts and nobody is addressed yet.
        epoch: under which the cloud acts.
        settings, inputs: from the configuration.
        stall_until_s: silence is not judged before this (our own stall), see cloud_fault.
    """

    incarnation: str
    partner: str
    epoch: int
    settings: Settings
    inputs: tuple[InputSpec, ...]
    stall_until_s: float


def cloud_fault(situation: Situation, link: Link, frame: Frame, now_s: float, *, acting: bool) -> Verdict | None:
    """The first broken hard limit, None when all hold. `acting`: the cloud is in charge, not only wished for.

    After a stall of our own process silence is judged anew from its end, but the cloud is never kept in charge for
    longer than a lease: it has stopped by then.
    """
    if now_s < frame.stall_until_s:
        known_s = situation.good_s if acting else now_s
        if known_s is not None and now_s - known_s <= frame.settings.lease_s:
            return None
        if known_s is not None:
            message = "The robot's own control process stood still for longer than a lease, the cloud has stopped"
            return Verdict(Site.ROBOT, Reason.CONTROL_STALLED, message)
    checks = [
        _pulse(situation, link, frame, now_s),
        _identity(situation, frame),
        _data(situation, link, now_s),
    ]
    if acting:
        checks += [_acting(situation, link, frame, now_s)]
    checks += [_collector(situation, frame, now_s), _inputs(situation, frame)]
    for found in checks:
        for reason, message in found:
            return Verdict(Site.ROBOT, reason, message)
    return None


def fitness(link: Link, settings: Settings, now_s: float) -> Fitness:
    """The thesis's rule on the loop latency: t_l + t_c_cloud <= t_c_robot + tolerance."""
    latency_s = links.latency_s(link, now_s, settings.beat_period_s)
    limit_s = settings.allowed_loop_s
    silent_s = float("inf") if link.heard_s is None else now_s - link.heard_s
    if latency_s > limit_s:
        shown = "unknown" if latency_s == float("inf") else f"{latency_s * 1e3:.0f} ms"
        message = f"Loop latency {shown} is over the limit of {limit_s * 1e3:.0f} ms"
        return Fitness(False, Reason.LATENCY_TOO_HIGH, message, latency_s, silent_s)
    return Fitness(True, Reason.LINK_GOOD, f"Loop latency {latency_s * 1e3:.0f} ms", latency_s, silent_s)


def clock_fault(link: Link, settings: Settings) -> Verdict | None:
    """The veto on system clocks that differ: user nodes compare stamps."""
    excess_s = links.clock_excess_s(link)
    if excess_s <= settings.max_clock_offset_s:
        return None
    message = (
        f"The system clocks differ by at least {excess_s * 1e3:.0f} ms, the limit is "
        f"{settings.max_clock_offset_s * 1e3:.0f} ms; synchronise them (chrony, ptp)"
    )
    return Verdict(Site.ROBOT, Reason.CLOCK_OFFSET, message)


Findings = Iterator[tuple[Reason, str]]


def _pulse(situation: Situation, link: Link, frame: Frame, now_s: float) -> Findings:
    timeout_s = frame.settings.loss_timeout_s
    if situation.pulse_s is None or now_s - situation.pulse_s > timeout_s:
        yield Reason.PULSE_SILENT, "The robot's own pulse process does not send"
    if link.heard_s is None:
        yield Reason.NEVER_HEARD, "The cloud has not been heard yet"
        return
    if now_s - link.heard_s > timeout_s:
        yield Reason.HEARTBEAT_LOST, f"No heartbeat from the cloud for {(now_s - link.heard_s) * 1e3:.0f} ms"
    age_s = situation.control_age_s
    if situation.report is None or age_s is None or age_s > timeout_s:
        yield Reason.CLOUD_CONTROL_SILENT, "The cloud's control process does not renew its report"
    refused = situation.report is not None and situation.report.refused == frame.incarnation
    echo_stale = link.echo_sent_s is None or now_s - link.echo_sent_s > frame.settings.echo_limit_s
    if echo_stale and not refused:  # who is refused gets no echoes: the refusal is what a person must read
        yield Reason.ECHO_STALE, "The cloud is heard but has not heard us in time"


def _identity(situation: Situation, frame: Frame) -> Findings:
    report = situation.report
    if report is None:
        return
    if report.refused == frame.incarnation:
        yield (
            Reason.DUPLICATE_IDENTITY,
            "Another robot with this identity is being served; give each robot its own bundle",
        )
    if report.serves != frame.incarnation:
        yield Reason.NOT_SERVED, "The cloud does not serve this robot (yet)"


def _data(situation: Situation, link: Link, now_s: float) -> Findings:
    if situation.data_s is None or now_s - situation.data_s > DATA_TIMEOUT_S:
        yield Reason.DATA_PROCESS_SILENT, "The robot's own data process does not report"
    elif not situation.data_connected:
        yield Reason.DATA_DISCONNECTED, "The data session is not connected"
    elif situation.data_heard_s is None or now_s - situation.data_heard_s > DATA_TIMEOUT_S:
        yield Reason.DATA_SILENT, "Nothing arrives on the data session"
    elif situation.data_cloud != link.peer:
        yield Reason.DATA_MISMATCH, "Pulse and data sessions end at different cloud agents"
    report = situation.report
    if report is not None and not 0 <= report.data_age_us <= DATA_TIMEOUT_S * 1e6:
        yield Reason.DATA_UNHEARD, "The cloud hears nothing on the data session"


def _acting(situation: Situation, link: Link, frame: Frame, now_s: float) -> Findings:
    if link.peer != frame.partner:
        yield Reason.CLOUD_RESTARTED, "Another incarnation of the cloud agent answers"
    report = situation.report
    if report is not None and not report.ready:
        yield Reason.CLOUD_NODES_DOWN, "The cloud's CORE nodes are not Active"
    says_so = report is not None and report.acting and report.epoch == frame.epoch
    if not says_so or situation.good_s is None or now_s - situation.good_s > frame.settings.loss_timeout_s:
        yield Reason.CLOUD_NOT_ACTING, "The cloud is heard but does not act under the current epoch"
    gate = situation.gate
    if gate is not None and not gate.cloud_flows:
        yield Reason.OUTPUT_SILENT, "A rated output of the cloud is silent"


def _collector(situation: Situation, frame: Frame, now_s: float) -> Findings:
    gate = situation.gate
    if gate is None or situation.gate_s is None or now_s - situation.gate_s > frame.settings.lease_s:
        yield Reason.COLLECTOR_SILENT, "The collector does not report"
    elif gate.fell_back and gate.charge is not None and gate.charge.token.epoch >= frame.epoch:
        yield Reason.COLLECTOR_FELL_BACK, "The collector did not hear control for too long and passes only the robot"


def _inputs(situation: Situation, frame: Frame) -> Findings:
    report = situation.report
    required = [i for i in frame.inputs if i.max_age_s > 0]
    if report is None:
        return
    if len(report.input_ages_us) != len(required):
        yield Reason.INPUTS_DIFFER, "Robot and cloud are configured with different inputs"
        return
    for spec, age_us in zip(required, report.input_ages_us, strict=True):
        if not 0 <= age_us <= spec.max_age_s * 1e6:
            shown = "never arrived" if age_us < 0 else f"is {age_us / 1e3:.0f} ms old"
            yield (
                Reason.INPUT_STALE,
                f"Input {spec.name} {shown} in the cloud, the limit is {spec.max_age_s * 1e3:.0f} ms",
            )
