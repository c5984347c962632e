"""The hard limits: the worst of pulse, data, inputs and outputs decides whether the cloud may act (protocol section 1).

One ordered table. Any broken limit ends a stay in the cloud at once and forbids a new one. The column `basis` states
what happens after a stall of the robot's own control process. Silence counts anew from the end of the stall, because
messages may still be unread. Reports are judged at once, because a stall of ours cannot cause them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from robot_offload_core.control.robot.health import Circumstances, Situation
from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Link
from robot_offload_core.words.beats import CloudReport
from robot_offload_core.words.reasons import Reason, Verdict, silence

DATA_TIMEOUT_S = 0.5
"""Silence of the probes (ten a second) after which the data session is dead; rated outputs are judged sooner."""


class Readings(NamedTuple):
    """Values checked against the limits; `report` is the situation's. Times on the robot's steady clock, seconds."""

    situation: Situation
    link: Link
    frame: Circumstances
    now_s: float
    report: CloudReport | None

    def silent(self, heard_s: float | None, limit_s: float) -> bool:
        """Return whether nothing was heard for longer than the limit, or ever."""
        return heard_s is None or self.now_s - heard_s > limit_s


class Basis(Enum):
    """What a limit is judged by: silence (counts from the end of a stall) or a report (counts at once)."""

    SILENCE = "silence"
    REPORTED = "reported"


@dataclass(frozen=True)
class Limit:
    """One hard limit.

    Attributes:
        reason: given when the limit is broken.
        basis: see Basis.
        only_acting: judged only while the cloud is in charge.
        broken: returns the message while the limit is broken, "" while it holds.
    """

    reason: Reason
    basis: Basis
    only_acting: bool
    broken: Callable[[Readings], str]


def cloud_fault(
    situation: Situation, link: Link, frame: Circumstances, now_s: float, *, acting: bool,
    without: frozenset[Reason] = frozenset(),
) -> Verdict | None:  # fmt: skip
    """Return the first broken hard limit, None if all hold.

    After a stall of our own process the cloud is kept in charge for a lease at most: it has stopped by then. A process
    that stalls repeatedly judges silence anyway, or rather reports that it is unable to judge.

    Args:
        situation: everything heard besides the link.
        link: to the cloud addressed.
        frame: the values against which the situation is judged.
        now_s: on the robot's steady clock.
        acting: the cloud is in charge, not only wished for.
        without: limits that are not judged.
    """
    stalled = now_s < frame.stall_until_s
    view = Readings(situation, link, frame, now_s, situation.report)
    if stalled:
        fault = _stalled(view, acting)
        if fault is not None:
            return fault
    for limit in JUDGED[acting][stalled]:
        message = limit.broken(view)
        if message and limit.reason not in without:
            return Verdict(Site.ROBOT, limit.reason, message)
    return None


def _stalled(view: Readings, acting: bool) -> Verdict | None:
    if view.frame.starved:
        message = (
            "The robot's own control process gets its CPU in slices and cannot distinguish silence from its own pauses"
        )
        return Verdict(Site.ROBOT, Reason.CONTROL_STARVED, message)
    if acting and view.silent(view.situation.good_s, view.frame.settings.lease_s):
        message = "The robot's own control process stood still for longer than a lease, the cloud has stopped"
        return Verdict(Site.ROBOT, Reason.CONTROL_STALLED, message)
    return None


# -- pulse ------------------------------------------------------------------------------------------------------------


def _pulse_silent(view: Readings) -> str:
    broken = view.silent(view.situation.pulse_s, view.frame.settings.loss_timeout_s)
    return "The robot's own pulse process does not send" if broken else ""


def _never_heard(view: Readings) -> str:
    return "The cloud has not been heard yet" if view.link.heard_s is None else ""


def _heartbeat_lost(view: Readings) -> str:
    heard_s = view.link.heard_s
    if heard_s is None or not view.silent(heard_s, view.frame.settings.loss_timeout_s):
        return ""
    return f"No heartbeat from the cloud for {(view.now_s - heard_s) * 1e3:.0f} ms"


def _cloud_control_silent(view: Readings) -> str:
    age_s = view.situation.control_age_s
    if view.link.heard_s is None:
        return ""
    broken = view.report is None or age_s is None or age_s > view.frame.settings.loss_timeout_s
    return "The cloud's control process does not renew its report" if broken else ""


def _echo_stale(view: Readings) -> str:
    refused = view.report is not None and view.report.refused == view.frame.incarnation
    if refused or not view.silent(view.link.echo_sent_s, view.frame.settings.echo_limit_s):
        return ""  # who is refused gets no echoes: the refusal is what a person must read
    return "The cloud is heard but has not heard us in time"


# -- identity ---------------------------------------------------------------------------------------------------------


def _duplicate_identity(view: Readings) -> str:
    broken = view.report is not None and view.report.refused == view.frame.incarnation
    return "Another robot with this identity is being served; give each robot its own bundle" if broken else ""


def _not_served(view: Readings) -> str:
    broken = view.report is not None and view.report.serves != view.frame.incarnation
    return "The cloud does not serve this robot (yet)" if broken else ""


# -- data -------------------------------------------------------------------------------------------------------------


def _data_process_silent(view: Readings) -> str:
    broken = view.silent(view.situation.data_s, DATA_TIMEOUT_S)
    return "The robot's own data process does not report" if broken else ""


def _data_disconnected(view: Readings) -> str:
    broken = view.situation.data_s is not None and not view.situation.data_connected
    return "The data session is not connected" if broken else ""


def _data_silent(view: Readings) -> str:
    return "Nothing arrives on the data session" if view.silent(view.situation.data_heard_s, DATA_TIMEOUT_S) else ""


def _data_mismatch(view: Readings) -> str:
    broken = view.situation.data_heard_s is not None and view.situation.data_cloud != view.link.peer
    return "Pulse and data sessions end at different cloud agents" if broken else ""


def _data_unheard(view: Readings) -> str:
    broken = view.report is not None and not 0 <= view.report.data_age_us <= DATA_TIMEOUT_S * 1e6
    return "The cloud hears nothing on the data session" if broken else ""


# -- a cloud in charge ------------------------------------------------------------------------------------------------


def _cloud_restarted(view: Readings) -> str:
    return "Another incarnation of the cloud agent answers" if view.link.peer != view.frame.partner else ""


def _cloud_nodes_down(view: Readings) -> str:
    return "The cloud's CORE nodes are not Active" if view.report is not None and not view.report.ready else ""


NOT_ACTING = "The cloud is heard but does not act under the current epoch"


def _not_acting(view: Readings) -> str:
    says_so = view.report is not None and view.report.acting and view.report.epoch == view.frame.epoch
    return "" if says_so else NOT_ACTING


def _no_good_beat(view: Readings) -> str:
    return NOT_ACTING if view.silent(view.situation.good_s, view.frame.settings.loss_timeout_s) else ""


def _output_silent(view: Readings) -> str:
    gate = view.situation.gate
    if gate is None or gate.cloud_flows:
        return ""
    return silence(Site.CLOUD, gate.names(gate.cloud_silent, view.frame.outputs))


# -- collector and inputs ---------------------------------------------------------------------------------------------


def _collector_silent(view: Readings) -> str:
    broken = view.situation.gate is None or view.silent(view.situation.gate_s, view.frame.settings.lease_s)
    return "The collector does not report" if broken else ""


def _collector_fell_back(view: Readings) -> str:
    gate = view.situation.gate
    if gate is None or gate.charge is None or not gate.fell_back or gate.charge.token.epoch < view.frame.epoch:
        return ""
    return "The collector did not hear control for too long and passes only the robot"


def _configuration_differs(view: Readings) -> str:
    theirs, ours = "" if view.report is None else view.report.shape, view.frame.shape
    if not theirs or not ours or theirs == ours:  # an older cloud says none: then numbers alone can be compared
        return ""
    return (
        "The required inputs or the outputs of the cloud's configuration are not those of the robot's, in the same "
        "order; make a new bundle for the robot"
    )


def _inputs_differ(view: Readings) -> str:
    required = sum(1 for i in view.frame.inputs if i.max_age_s > 0)
    broken = view.report is not None and len(view.report.input_ages_us) != required
    return "Robot and cloud are configured with different inputs" if broken else ""


def _input_stale(view: Readings) -> str:
    return next(_stale_inputs(view), "")


def _stale_inputs(view: Readings) -> Iterator[str]:
    required = (i for i in view.frame.inputs if i.max_age_s > 0)
    ages_us = () if view.report is None else view.report.input_ages_us
    for spec, age_us in zip(required, ages_us):  # noqa: B905 - other lengths are InputsDiffer
        if not 0 <= age_us <= spec.max_age_s * 1e6:
            shown = "never arrived" if age_us < 0 else f"is {age_us / 1e3:.0f} ms old"
            yield f"Input {spec.name} {shown} in the cloud, the limit is {spec.max_age_s * 1e3:.0f} ms"


_S, _R = Basis.SILENCE, Basis.REPORTED
LIMITS: tuple[Limit, ...] = (
    Limit(Reason.PULSE_SILENT, _S, False, _pulse_silent),
    Limit(Reason.NEVER_HEARD, _S, False, _never_heard),
    Limit(Reason.HEARTBEAT_LOST, _S, False, _heartbeat_lost),
    Limit(Reason.CLOUD_CONTROL_SILENT, _R, False, _cloud_control_silent),
    Limit(Reason.ECHO_STALE, _S, False, _echo_stale),
    Limit(Reason.DUPLICATE_IDENTITY, _R, False, _duplicate_identity),
    Limit(Reason.NOT_SERVED, _R, False, _not_served),
    Limit(Reason.DATA_PROCESS_SILENT, _S, False, _data_process_silent),
    Limit(Reason.DATA_DISCONNECTED, _R, False, _data_disconnected),
    Limit(Reason.DATA_SILENT, _S, False, _data_silent),
    Limit(Reason.DATA_MISMATCH, _R, False, _data_mismatch),
    Limit(Reason.DATA_UNHEARD, _R, False, _data_unheard),
    Limit(Reason.CLOUD_RESTARTED, _R, True, _cloud_restarted),
    Limit(Reason.CLOUD_NODES_DOWN, _R, True, _cloud_nodes_down),
    Limit(Reason.CLOUD_NOT_ACTING, _R, True, _not_acting),
    Limit(Reason.CLOUD_NOT_ACTING, _S, True, _no_good_beat),
    Limit(Reason.OUTPUT_SILENT, _R, True, _output_silent),
    Limit(Reason.COLLECTOR_SILENT, _S, False, _collector_silent),
    Limit(Reason.COLLECTOR_FELL_BACK, _R, False, _collector_fell_back),
    Limit(Reason.CONFIGURATION_DIFFERS, _R, False, _configuration_differs),
    Limit(Reason.INPUTS_DIFFER, _R, False, _inputs_differ),
    Limit(Reason.INPUT_STALE, _R, False, _input_stale),
)
"""In order: the first broken one is returned, causes before their consequences."""
JUDGED: tuple[tuple[tuple[Limit, ...], ...], ...] = tuple(
    tuple(
        tuple(
            limit
            for limit in LIMITS
            if (acting or not limit.only_acting) and not (stalled and limit.basis is Basis.SILENCE)
        )
        for stalled in (False, True)
    )
    for acting in (False, True)
)
"""The limits to judge, by whether the cloud acts and whether our own process has stalled."""
