"""Uses of a Hot replica on the robot: its newest message is at hand, and it shows that the cloud's is missing.

Part of the collector (gate.py), whose state these functions read and change.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from robot_offload_core.collector import lateness
from robot_offload_core.fence import gate as fence
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.replace import replace

OVERDUE_LOOK_S = 0.005
"""Least time between two looks for an overdue message."""

if TYPE_CHECKING:
    from robot_offload_core.collector.state import Collector, OutputState


def hear(collector: Collector, index: int, envelope: Envelope, now_s: float) -> Collector:
    """Record how late a message of the cloud came, whether or not it passes; only for Hot outputs."""
    state, charge, following = collector.outputs[index], collector.charge, collector.next
    known, spec = state.late, state.spec
    ours = (charge and charge.token, following and following.token, known.token)
    if not _hot(collector, state) or envelope.token not in ours:
        return collector
    late = lateness.hear(known, envelope.token, envelope.sequence, now_s, spec.period_s, spec.deadline_s)
    outputs = (*collector.outputs[:index], replace(state, late=late), *collector.outputs[index + 1 :])
    return replace(collector, outputs=outputs)


def note(outputs: tuple[OutputState, ...], gate: Gate) -> tuple[OutputState, ...]:
    """Take over the least margins that control names."""
    named = dict(gate.floors)
    return tuple(
        o if o.floor_s == named.get(i, 0.0) else replace(o, floor_s=named.get(i, 0.0)) for i, o in enumerate(outputs)
    )


def _hot(collector: Collector, output: OutputState) -> bool:
    spec = output.spec
    return collector.loss_timeout_s > 0 and spec.rated and spec.period_s > 0 and Site.ROBOT in spec.hot


def due_s(collector: Collector, output: OutputState, now_s: float) -> float:
    """Return when the cloud's next message of a Hot output counts as lost; infinite if none is expected.

    None is expected before the cloud's first message of the present stay. After a pause the collector first reads what
    has arrived meanwhile.
    """
    charge, late = collector.charge, output.late
    if charge is None or not _cloud_passes(collector) or late.token != charge.token or not _hot(collector, output):
        return math.inf
    spec = output.spec
    most_s = spec.deadline_s - spec.period_s
    margin_s = lateness.margin_s(late, now_s, collector.loss_timeout_s, output.floor_s, most_s)
    return max(late.arrived_s + spec.period_s + margin_s, collector.judged_from_s)


def next_look_s(collector: Collector, now_s: float) -> float:
    """Return when to look again, because a message of the cloud counts as lost then; infinite if none is expected.

    Once it is overdue, only a message of the robot's replica must come before it counts as lost: looks are frequent.
    """
    times = (due_s(collector, o, now_s) for o in collector.outputs if not o.late.missed)
    due = min(times, default=math.inf)
    return due if due == math.inf else max(due, now_s + OVERDUE_LOOK_S)


def look(collector: Collector, now_s: float) -> Collector:
    """Record which messages of the cloud are lost; called after everything that arrived was read."""
    outputs = tuple(
        replace(o, late=replace(o.late, missed=True)) if not o.late.missed and missed(collector, o, now_s) else o
        for o in collector.outputs
    )
    return collector if outputs == collector.outputs else replace(collector, outputs=outputs)


def missed(collector: Collector, output: OutputState, now_s: float) -> bool:
    """Return whether the cloud's next message is lost: it is overdue, and the robot's replica has published since.

    If both are silent, that proves nothing.
    """
    spoke_s, heard_s = output.robot_s, output.late.arrived_s
    return spoke_s is not None and spoke_s > heard_s and now_s >= due_s(collector, output, now_s)


def release(before: Collector, after: Collector, now_s: float) -> tuple[Collector, tuple[int, ...]]:
    """Return the outputs whose kept message of the robot passes now, because the robot has taken over from the cloud.

    A message of a Hot replica passes if it is no older than a period (without a rate: than `max_age_s`), a latched one
    at any age.
    """
    if not (_cloud_passes(before) and not _cloud_passes(after)):
        return after, ()
    passing = tuple(i for i, o in enumerate(after.outputs) if _releases(after, o, now_s))
    passing = tuple(i for i in passing if fence.robot(after.fence, i, now_s)[1].passes)
    outputs = tuple(replace(o, standby_new=False) if i in passing else o for i, o in enumerate(after.outputs))
    return replace(after, outputs=outputs), passing


def _cloud_passes(collector: Collector) -> bool:
    charge = collector.charge
    return charge is not None and charge.site is Site.CLOUD and not collector.fell_back


def _releases(collector: Collector, output: OutputState, now_s: float) -> bool:
    spec = output.spec
    if output.standby_s is None or not output.standby_new:
        return False
    return spec.latched or now_s - output.standby_s <= (spec.period_s or collector.max_age_s)
