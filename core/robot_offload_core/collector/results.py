"""Which result of a node with placement Cloud passes: the node has no replica, so either side may be in charge.

A result passes by the exact token of its `presence` grant, in order, and by its age. Nothing else keeps results of a
stalled link from the consumers, so the age is judged per message, and control must have sent an order within a lease.
"""

from __future__ import annotations

from robot_offload_core.collector.state import Collector, OutputState
from robot_offload_core.fence import gate as fence
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.words.gates import Passage, Ruling
from robot_offload_core.words.replace import replace


def offer(collector: Collector, index: int, envelope: Envelope, now_s: float) -> tuple[Collector, Passage]:
    """Judge a message that arrived from the cloud for output `index`.

    Args:
        collector: state of the gate.
        index: of an output of a node with placement Cloud.
        envelope: header of the message.
        now_s: on the robot's steady clock.
    """
    state = collector.outputs[index]
    judged, ruling = fence.result(collector.fence, index, envelope, now_s, state.spec.max_age_s or collector.max_age_s)
    if ruling is fence.Ruling.STALE:
        collector = _heard(collector, index, replace(state, stale=True))
    if ruling.passes:
        collector = replace(_heard(collector, index, replace(state, cloud_s=now_s, stale=False)), fence=judged)
    return collector, Passage(Ruling.of(ruling))


def _heard(collector: Collector, index: int, state: OutputState) -> Collector:
    outputs = (*collector.outputs[:index], state, *collector.outputs[index + 1 :])
    return replace(collector, outputs=outputs)
