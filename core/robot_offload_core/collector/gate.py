"""Which message passes: the gate in front of the consumers (protocol sections 2 and 3).

The collector holds the token of the side in charge and, while a commanded switch is under way, the one of the side
that is getting ready. It passes the old side until the new side's rated outputs flow (on control's word when none is
rated), changes over between two messages for all outputs at once, and never goes back: a token is accepted by equality
only. When control falls silent for as long as a lease lasts it passes the robot and refuses the cloud until control
names a new epoch. What it does for the cloud it does on control's word alone, and that word counts from when control
said it, not from when it was read.

Of Hot replicas on the robot it knows the newest message, which passes when the robot takes over; and it says at once
when a message of the cloud does not come although such a replica has spoken (lateness.py).
"""

from __future__ import annotations

import math

from robot_offload_core.collector import active_while, standby
from robot_offload_core.collector.state import Collector, OutputState
from robot_offload_core.words import slow_outputs
from robot_offload_core.words.checks import require
from robot_offload_core.words.envelope import Envelope
from robot_offload_core.words.gates import Charge, Gate, GateReport, Passage, Ruling
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import OutputSpec
from robot_offload_core.words.token import Site, Token

PAUSE_S = 0.120
"""Turns of this process further apart are a pause of the process, not silence of an output: six turns of 20 ms."""
HEALTHY_S = 0.5
"""After this long without a pause the process counts as healthy. An earlier second pause is not excused."""
PAUSE_GRACE_S = 0.100
"""After a pause, silence is not reported for this long: what waited is too old by then, new messages must come
first."""


def start(
    outputs: tuple[OutputSpec, ...], max_age_s: float, gate_timeout_s: float,
    loss_timeout_s: float = 0.0, activation_s: float = 0.0,
) -> Collector:  # fmt: skip
    """Return a collector that passes the robot until control speaks."""
    states = tuple(OutputState(spec) for spec in outputs)
    return Collector(max_age_s, gate_timeout_s, states, loss_timeout_s=loss_timeout_s, activation_s=activation_s)


def set_gate(collector: Collector, gate: Gate, now_s: float) -> Collector:
    """Take control's wish. It can only move forward: an epoch already left behind is never entered again."""
    after = _change_over_idle(_set_gate(collector, gate, now_s), now_s)
    check(collector, after, gate)
    return after


def check(before: Collector, after: Collector, event: object) -> None:
    """Raise InvariantError when the step from `before` to `after` broke what every step must keep."""
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
    """Change over on control's word when no output is to be waited for.

    An idle robot must be able to change: where nobody need speak there is nothing to pass twice and nothing to lose.
    """
    following = collector.next
    if following is None or any(_awaited(collector, o, following.site) for o in collector.outputs):
        return collector
    return _enter(collector, following, None, now_s)


def _set_gate(collector: Collector, gate: Gate, now_s: float) -> Collector:
    if gate.started_us < collector.started_us:
        return collector
    same_control = gate.started_us == collector.started_us
    said_s = now_s if gate.said_s is None else min(gate.said_s, now_s)
    collector = replace(
        collector, started_us=gate.started_us, gate_s=said_s, presence=gate.presence, prompt=gate.prompt,
        outputs=standby.note(active_while.note(collector.outputs, gate, now_s), gate),
    )  # fmt: skip
    ours, theirs = collector.charge, gate.current
    if ours is None or not same_control:
        return _enter(collector, theirs, gate.next, now_s)
    if theirs.token.epoch < ours.token.epoch:
        return collector  # already changed over to what control still calls next
    if theirs.token.epoch == ours.token.epoch:
        if collector.fell_back and ours.site is Site.CLOUD:
            return collector  # robot messages have passed since: only a new epoch may follow
        return _arm(replace(collector, fell_back=False), gate.next)
    return _enter(collector, theirs, gate.next, now_s)


def limit(
    collector: Collector,
    max_age_s: float,
    gate_timeout_s: float,
    loss_timeout_s: float = 0.0,
    activation_s: float = 0.0,
) -> Collector:
    """Take limits that were changed at run time; safe at any moment, they only bound what is refused or lost."""
    return replace(
        collector, max_age_s=max_age_s, gate_timeout_s=gate_timeout_s, loss_timeout_s=loss_timeout_s,
        activation_s=activation_s,
    )  # fmt: skip


def turn(collector: Collector, now_s: float) -> Collector:
    """Take a turn of the process's loop: notice a pause of its own, and what `tick` notices."""
    if collector.turned_s is not None and now_s - collector.turned_s > PAUSE_S:
        in_a_row = collector.paused_s is not None and now_s - collector.paused_s < HEALTHY_S
        judged_from_s = collector.judged_from_s if in_a_row else now_s + PAUSE_GRACE_S
        collector = replace(collector, judged_from_s=judged_from_s, paused_s=now_s)
    return tick(replace(collector, turned_s=now_s), now_s)


def tick(collector: Collector, now_s: float) -> Collector:
    """Return falls back to the robot when control has been silent for too long."""
    spoken_s = collector.resumed_s if collector.gate_s is None else collector.gate_s
    if collector.fell_back or spoken_s is None or now_s - spoken_s <= collector.gate_timeout_s:
        return collector
    after = replace(collector, fell_back=True, next=None)
    check(collector, after, "silence")
    return after


def site(collector: Collector) -> Site:
    """Return the side that passes: the robot also before control has spoken and after falling back."""
    charge = collector.charge
    return Site.ROBOT if charge is None or collector.fell_back else charge.site


def count_stay(before: Collector, after: Collector) -> Collector:
    """Return `after` with a stay of its own when another side passes than in `before`."""
    return after if site(before) is site(after) else replace(after, stay=before.stay + 1)


def resume(
    collector: Collector, charge: Charge, started_us: int, fell_back: bool, now_s: float, stay: int = 0
) -> Collector:
    """Take up what a collector that died had reached, so that nothing already left behind passes again.

    For the cloud it passes nothing before control has spoken, and nothing sent before `now_s`: the predecessor may have
    passed it. Silence counts from now: a restart of ours is nobody's silence.
    """
    return replace(collector, charge=charge, started_us=started_us, fell_back=fell_back, resumed_s=now_s, stay=stay)


def offer_robot(collector: Collector, index: int, sequence: int, now_s: float) -> tuple[Collector, Passage]:
    """Take a message of the robot's replica on output `index`; `sequence` grows with each of its messages."""
    collector = tick(collector, now_s)
    passes = collector.charge is None or collector.charge.site is Site.ROBOT or collector.fell_back
    hot = Site.ROBOT in collector.outputs[index].spec.hot
    collector = _output(collector, index, robot_s=now_s, standby_s=now_s if hot else None, standby_new=not passes)
    if passes:
        return _output(collector, index, last_sequence=sequence), Passage(Ruling.ROBOT_IN_CHARGE)
    if collector.next is None or collector.next.site is not Site.ROBOT:
        return collector, Passage(Ruling.CLOUD_IN_CHARGE)
    return _offer_next(collector, index, sequence, now_s, now_s)


def offer_cloud(collector: Collector, index: int, envelope: Envelope, now_s: float) -> tuple[Collector, Passage]:
    """Take a message of the cloud's replica for output `index`."""
    collector = standby.hear(tick(collector, now_s), index, envelope, now_s)
    if collector.fell_back or collector.charge is None or collector.gate_s is None:
        return collector, Passage(Ruling.CONTROL_SILENT)
    state = collector.outputs[index]
    latched = envelope.latched and state.spec.latched  # the last value of a topic that speaks seldom
    if not 0 <= envelope.age_s(now_s) <= (math.inf if latched else collector.max_age_s):  # less: an echo of nobody here
        return collector, Passage(Ruling.STALE)
    if collector.resumed_s is not None and envelope.echo_us / 1e6 < collector.resumed_s and not latched:
        return collector, Passage(Ruling.BEFORE_RESTART)
    if collector.charge.site is Site.CLOUD and envelope.token == collector.charge.token:
        if envelope.sequence <= state.last_sequence:
            return collector, Passage(Ruling.REORDERED)
        heard = _output(
            collector, index, cloud_s=now_s, last_sequence=envelope.sequence,
            standby_new=state.standby_new or state.spec.latched,
        )  # fmt: skip
        return heard, Passage(Ruling.CURRENT)
    following = collector.next
    if following is not None and following.site is Site.CLOUD and envelope.token == following.token:
        if envelope.sequence <= state.next_sequence:
            return collector, Passage(Ruling.REORDERED)
        collector = _output(collector, index, cloud_s=now_s)
        return _offer_next(collector, index, envelope.sequence, now_s if latched else envelope.echo_us / 1e6, now_s)
    return collector, Passage(Ruling.FOREIGN_TOKEN)


def admits_effect(collector: Collector, token: Token, now_s: float) -> Passage:
    """Return whether an effect that is not collected (a request through the agents) is the active side's."""
    collector = tick(collector, now_s)
    charge = collector.charge
    if collector.fell_back or charge is None or collector.gate_s is None:
        return Passage(Ruling.CONTROL_SILENT)
    if charge.site is not Site.CLOUD or charge.token != token:
        return Passage(Ruling.FOREIGN_TOKEN)
    return Passage(Ruling.CURRENT)


def report(collector: Collector, now_s: float) -> GateReport:
    """Return the state as control needs it."""
    judged = now_s >= collector.judged_from_s
    rated = [(i, o) for i, o in enumerate(collector.outputs) if o.spec.rated]
    idle = tuple(i for i, o in rated if not active_while.must_speak(o, Site.ROBOT, collector.activation_s, now_s))
    cloud_idle = tuple(i for i, o in rated if not active_while.must_speak(o, Site.CLOUD, collector.activation_s, now_s))
    acts = collector.charge is None or collector.charge.site is Site.ROBOT or collector.fell_back
    charged_s = collector.acts_s if acts else None  # a slow output speaks one period after its nodes woke
    cloud_s = None if acts else collector.acts_s  # where nobody waited for it
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
    """Return when silence next changes what is reported or passes; infinite when it changes nothing."""
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
    collector: Collector, index: int, sequence: int, born_s: float, now_s: float
) -> tuple[Collector, Passage]:
    """Take a valid message of the side that is to take over: change over once all rated outputs of it flow.

    The newest messages of its other outputs pass with it, as long as they are no older than any message may be: else
    their consumers would wait for the old side's and the new side's period together.
    """
    collector = _output(collector, index, next_ready_s=now_s, next_sequence=sequence, next_born_s=born_s)
    assert collector.next is not None
    side = collector.next.site
    if not all(_flows(collector, o, side, now_s) for o in collector.outputs):
        return collector, Passage(Ruling.NOT_ALL_READY)
    ready = {
        i
        for i, o in enumerate(collector.outputs)
        if i != index and o.next_ready_s is not None and now_s - o.next_born_s <= collector.max_age_s
    }
    before = collector
    collector = _output(_enter(collector, collector.next, None, now_s), index, standby_new=False)
    check(before, collector, sequence)
    collector, kept = standby.release(before, collector, now_s)
    for other in ready:
        collector = _output(collector, other, standby_new=False)
    also = tuple(sorted(ready | set(kept)))
    return _output(collector, index, last_sequence=sequence), Passage(Ruling.CHANGED_OVER, also)


def _flows(collector: Collector, output: OutputState, side: Site, now_s: float) -> bool:
    deadline_s = output.spec.deadline_s
    ready_s = output.next_ready_s
    return not _awaited(collector, output, side) or (ready_s is not None and now_s - ready_s <= deadline_s)


def _awaited(collector: Collector, output: OutputState, side: Site) -> bool:
    """Return whether a changeover to a side waits for an output: for no slow one while nobody acts, or nobody may."""
    held = not (collector.prompt and slow_outputs.is_slow(output.spec, collector.activation_s))
    return held and active_while.awaited(output, side)


def _enter(collector: Collector, charge: Charge, following: Charge | None, now_s: float) -> Collector:
    outputs = tuple(
        replace(o, last_sequence=o.next_sequence if charge == collector.next else -1, next_sequence=-1,
                next_ready_s=None)
        for o in collector.outputs
    )  # fmt: skip
    stays = collector.charge is not None and collector.charge.site is charge.site
    acts_s = collector.acts_s if stays else now_s
    collector = replace(
        collector, charge=charge, outputs=outputs, fell_back=False, flipped_s=now_s, acts_s=acts_s, next=None
    )
    return _arm(collector, following)


def _arm(collector: Collector, following: Charge | None) -> Collector:
    if following == collector.next:
        return collector
    assert collector.charge is not None
    if following is not None and following.token.epoch <= collector.charge.token.epoch:
        following = None  # only what is newer may follow
    outputs = tuple(replace(o, next_ready_s=None, next_sequence=-1) for o in collector.outputs)
    return replace(collector, next=following, outputs=outputs)


def _output(collector: Collector, index: int, **changes: float | bool | None) -> Collector:
    outputs = list(collector.outputs)
    outputs[index] = replace(outputs[index], **changes)  # type: ignore[arg-type]
    return replace(collector, outputs=tuple(outputs))
