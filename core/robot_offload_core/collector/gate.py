"""Which message passes: the gate in front of the consumers (protocol sections 2 and 3).

The collector holds the token of the side in charge and, during a commanded switch, the token of the side that gets
ready. It passes the old side until the new side's rated outputs flow (if none is rated: until control orders the
change). Then it changes over between two messages for all outputs at once. It never goes back: a token is accepted by
equality only. When control is silent for the length of a lease, the collector passes the robot and refuses the cloud
until control names a new epoch. It passes the cloud on control's order alone, and an order counts from when control
sent it, not from when it was read.

The collector keeps the newest message of each Hot replica on the robot; it passes when the robot takes over. It reports
at once when a message of the cloud is missing although such a replica has published (lateness.py).
"""

from __future__ import annotations

import math

from robot_offload_core.collector import active_while, standby
from robot_offload_core.collector.state import Collector, OutputState
from robot_offload_core.fence import gate as fence
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words import slow_outputs
from robot_offload_core.words.checks import require
from robot_offload_core.words.gates import Gate, GateReport, Passage, Ruling
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import OutputSpec

PAUSE_S = 0.120
"""A longer gap between turns is a pause of this process, not silence of an output: six turns of 20 ms."""
HEALTHY_S = 0.5
"""After this long without a pause the process counts as healthy. An earlier second pause is not excused."""
PAUSE_GRACE_S = 0.100
"""After a pause, silence is not reported for this long: messages that waited are too old, new ones must come first."""


def start(
    outputs: tuple[OutputSpec, ...], max_age_s: float, gate_timeout_s: float,
    loss_timeout_s: float = 0.0, activation_s: float = 0.0,
) -> Collector:  # fmt: skip
    """Return a collector that passes the robot until control sends its first order."""
    states = tuple(OutputState(spec) for spec in outputs)
    closed = fence.start(len(states), max_age_s, gate_timeout_s)
    return Collector(closed, states, loss_timeout_s=loss_timeout_s, activation_s=activation_s)


def set_gate(collector: Collector, gate: Gate, now_s: float) -> Collector:
    """Take an order of control. It only moves forward: an epoch already left behind is never entered again."""
    after = _change_over_idle(_set_gate(collector, gate, now_s), now_s)
    check(collector, after, gate)
    return after


def check(before: Collector, after: Collector, event: object) -> None:
    """Raise InvariantError if the step from `before` to `after` broke an invariant."""
    if after.charge is before.charge and after.next is before.next and after.fell_back is before.fell_back:
        return
    ours, theirs, following = before.charge, after.charge, after.next
    same = after.started_us == before.started_us
    require(
        "collector",
        event,
        (theirs is not None or ours is None, "who passes was forgotten"),
        (after.started_us >= before.started_us, "an earlier control was heard"),
        (ours is None or theirs is None or not same or theirs.token.epoch >= ours.token.epoch, "the epoch fell"),
        (following is None or (theirs is not None and following.token.epoch > theirs.token.epoch), "next is not newer"),
        (following is None or not after.fell_back, "fell back, and somebody is next"),
    )


def _change_over_idle(collector: Collector, now_s: float) -> Collector:
    """Change over on control's order if there is no output to wait for.

    An idle robot must be able to change: if no output must publish, nothing can pass twice or be lost.
    """
    following = collector.next
    if following is None or any(_awaited(collector, o, following.site) for o in collector.outputs):
        return collector
    return _took(collector, fence.take_over(collector.fence, now_s), now_s)


def _set_gate(collector: Collector, gate: Gate, now_s: float) -> Collector:
    if gate.started_us < collector.started_us:
        return collector
    said_s = now_s if gate.said_s is None else gate.said_s
    word = fence.Word(gate.started_us, gate.current, gate.next, said_s, gate.presence)
    outputs = standby.note(active_while.note(collector.outputs, gate, now_s), gate)
    collector = replace(collector, prompt=gate.prompt, outputs=outputs)
    return _took(collector, fence.order(collector.fence, word, now_s), now_s)


def _took(collector: Collector, after: fence.Gate, now_s: float) -> Collector:
    """Return the collector with the fence's next state; record the time if another side or epoch is in charge."""
    ours, theirs = collector.fence.charge, after.charge
    if theirs != ours or after.next != collector.fence.next:
        outputs = tuple(o if o.next_ready_s is None else replace(o, next_ready_s=None) for o in collector.outputs)
        collector = replace(collector, outputs=outputs)
    if theirs == ours or theirs is None:
        return replace(collector, fence=after)
    stays = ours is not None and ours.site is theirs.site
    return replace(collector, fence=after, flipped_s=now_s, acts_s=collector.acts_s if stays else now_s)


def limit(
    collector: Collector,
    max_age_s: float,
    gate_timeout_s: float,
    loss_timeout_s: float = 0.0,
    activation_s: float = 0.0,
) -> Collector:
    """Apply limits changed at run time; safe at any moment, they only bound what is refused or counts as lost."""
    limited = fence.limit(collector.fence, max_age_s, gate_timeout_s)
    return replace(collector, fence=limited, loss_timeout_s=loss_timeout_s, activation_s=activation_s)


def turn(collector: Collector, now_s: float) -> Collector:
    """Run a turn of the process's loop: detect a pause of this process, then `tick`."""
    if collector.turned_s is not None and now_s - collector.turned_s > PAUSE_S:
        in_a_row = collector.paused_s is not None and now_s - collector.paused_s < HEALTHY_S
        judged_from_s = collector.judged_from_s if in_a_row else now_s + PAUSE_GRACE_S
        collector = replace(collector, judged_from_s=judged_from_s, paused_s=now_s)
    return tick(replace(collector, turned_s=now_s), now_s)


def tick(collector: Collector, now_s: float) -> Collector:
    """Fall back to the robot when control has been silent for too long."""
    ticked = fence.tick(collector.fence, now_s)
    if ticked is collector.fence:
        return collector
    after = replace(collector, fence=ticked)
    check(collector, after, "silence")
    return after


def site(collector: Collector) -> Site:
    """Return the side that passes: the robot also before control has spoken and after falling back."""
    return fence.site(collector.fence)


def count_stay(before: Collector, after: Collector) -> Collector:
    """Return `after`, with the next stay number if another side passes than in `before`."""
    return after if site(before) is site(after) else replace(after, stay=before.stay + 1)


def resume(
    collector: Collector, charge: Charge, started_us: int, fell_back: bool, now_s: float, stay: int = 0
) -> Collector:
    """Continue from the state of a collector that died, so that no earlier stay passes again.

    Nothing of the cloud passes before control's first order, nor anything sent before `now_s`: the predecessor may have
    passed it. Silence counts from now: our restart is not silence of another process.
    """
    resumed = fence.resume(collector.fence, charge, started_us, fell_back, now_s)
    return replace(collector, fence=resumed, stay=stay)


def offer_robot(
    collector: Collector, index: int, sequence: int, now_s: float, known: fence.Known = fence.EVERYTHING
) -> tuple[Collector, Passage]:
    """Take a message of the robot's replica on output `index`; `sequence` grows with each of its messages."""
    collector = tick(collector, now_s)
    judged, ruling = fence.robot(collector.fence, index, now_s, known)
    hot = Site.ROBOT in collector.outputs[index].spec.hot
    collector = replace(
        _output(
            collector, index, robot_s=now_s, standby_s=now_s if hot else None, standby_new=not ruling.passes
        ), fence=judged,
    )  # fmt: skip
    if ruling is fence.Ruling.NOT_ALL_READY:
        return _offer_next(collector, index, sequence, now_s, known)
    return collector, Passage(Ruling.of(ruling))


def offer_cloud(
    collector: Collector, index: int, envelope: Envelope, now_s: float, known: fence.Known = fence.EVERYTHING
) -> tuple[Collector, Passage]:
    """Take a message of the cloud's replica for output `index`."""
    collector = standby.hear(tick(collector, now_s), index, envelope, now_s)
    state = collector.outputs[index]
    latched = envelope.latched and state.spec.latched  # the last value of a topic that speaks seldom
    judged, ruling = fence.cloud(collector.fence, index, envelope, now_s, known, lasts=latched)
    if judged is not collector.fence:
        collector = replace(collector, fence=judged)
    if ruling is fence.Ruling.NOT_ALL_READY:
        return _offer_next(_output(collector, index, cloud_s=now_s), index, envelope.sequence, now_s, known)
    if ruling.passes:
        collector = _output(collector, index, cloud_s=now_s, standby_new=state.standby_new or state.spec.latched)
    return collector, Passage(Ruling.of(ruling))


def admits_effect(collector: Collector, token: Token, now_s: float) -> Passage:
    """Rule whether an effect that is not collected (a request through the agents) comes from the active side."""
    return Passage(Ruling.of(fence.effect(collector.fence, token, now_s)))


def report(collector: Collector, now_s: float) -> GateReport:
    """Return the state as control needs it."""
    judged = now_s >= collector.judged_from_s
    rated = [(i, o) for i, o in enumerate(collector.outputs) if o.spec.rated]
    idle = tuple(i for i, o in rated if not active_while.must_speak(o, Site.ROBOT, collector.activation_s, now_s))
    cloud_idle = tuple(i for i, o in rated if not active_while.must_speak(o, Site.CLOUD, collector.activation_s, now_s))
    acts = collector.charge is None or collector.charge.site is Site.ROBOT or collector.fell_back
    charged_s = collector.acts_s if acts else None  # a slow output speaks one period after its nodes woke
    cloud_s = None if acts else collector.acts_s  # for outputs that no changeover waits for
    resumed_s = collector.resumed_s

    def flows(output: OutputState, *since_s: float | None) -> bool:
        known = [t for t in since_s if t is not None]
        return bool(known) and (now_s - max(known) <= output.spec.deadline_s or not judged)

    def robot_flows(output: OutputState) -> bool:
        return flows(output, output.robot_s, charged_s, resumed_s)

    def cloud_flows(output: OutputState) -> bool:
        waited = not slow_outputs.is_slow(output.spec, collector.activation_s)
        return flows(output, output.cloud_s, None if waited else cloud_s, resumed_s)

    flowing = tuple(i for i, o in rated if o.robot_s is not None and now_s - o.robot_s <= o.spec.deadline_s)
    heard = tuple(i for i, o in enumerate(collector.outputs) if o.spec.deadline_s > 0 and cloud_flows(o))
    stale = tuple(i for i, o in enumerate(collector.outputs) if o.stale)
    robot_silent = tuple(i for i, o in rated if i not in idle and not robot_flows(o))
    cloud_silent = tuple(i for i, o in rated if i not in cloud_idle and not cloud_flows(o))
    missed = tuple(
        (i, o.late.arrived_s + o.spec.period_s)
        for i, o in rated
        if o.late.missed and standby.missed(collector, o, now_s)
    )
    return GateReport(
        collector.charge, collector.fell_back, not robot_silent, not cloud_silent, flowing, heard, stale,
        robot_silent, cloud_silent, idle, missed,
    )  # fmt: skip


def next_deadline_s(collector: Collector, now_s: float) -> float:
    """Return when silence next changes what is reported or passes; infinite if it changes nothing."""
    times = [collector.judged_from_s]
    if not collector.fell_back:
        times += [t + collector.gate_timeout_s for t in (collector.gate_s, collector.resumed_s) if t is not None]
    for output in collector.outputs:
        if not output.spec.deadline_s:
            continue
        since_s = (output.robot_s, output.cloud_s, collector.acts_s, collector.resumed_s)
        times += [t + output.spec.deadline_s for t in since_s if t is not None]
        if output.spec.while_ is not None:
            while_s = (output.robot_while_s, output.cloud_while_s)
            times += [t + collector.activation_s for t in while_s if t is not None]
    return min([at_s for at_s in times if at_s >= now_s], default=math.inf)


def _offer_next(
    collector: Collector, index: int, event: object, now_s: float, known: fence.Known
) -> tuple[Collector, Passage]:
    """Take a valid message of the side that is to take over: change over once all its rated outputs flow.

    The newest messages of its other outputs pass too, unless they are too old. Otherwise their consumers would wait for
    the old side's and the new side's period together.
    """
    collector = _output(collector, index, next_ready_s=now_s)
    assert collector.next is not None
    side = collector.next.site
    if not all(_flows(collector, o, side, now_s) for o in collector.outputs):
        return collector, Passage(Ruling.NOT_ALL_READY)
    before = collector
    changed, passes = fence.release(fence.take_over(collector.fence, now_s), index, now_s, known)
    assert passes, "a message that is held is young enough at this very moment"
    ready = set()
    for other in range(len(collector.outputs)):
        changed, passes = fence.release(changed, other, now_s)
        ready |= {other} if passes else set()
    collector = _output(_took(collector, changed, now_s), index, standby_new=False)
    check(before, collector, event)
    collector, kept = standby.release(before, collector, now_s)
    for other in ready:
        collector = _output(collector, other, standby_new=False)
    return collector, Passage(Ruling.CHANGED_OVER, tuple(sorted(ready | set(kept))))


def _flows(collector: Collector, output: OutputState, side: Site, now_s: float) -> bool:
    deadline_s = output.spec.deadline_s
    ready_s = output.next_ready_s
    return not _awaited(collector, output, side) or (ready_s is not None and now_s - ready_s <= deadline_s)


def _awaited(collector: Collector, output: OutputState, side: Site) -> bool:
    """Return whether a changeover to a side waits for an output; with `prompt` it waits for no slow one."""
    held = not (collector.prompt and slow_outputs.is_slow(output.spec, collector.activation_s))
    return held and active_while.awaited(output, side)


def _output(collector: Collector, index: int, **changes: float | bool | None) -> Collector:
    outputs = list(collector.outputs)
    outputs[index] = replace(outputs[index], **changes)  # type: ignore[arg-type]
    return replace(collector, outputs=tuple(outputs))
