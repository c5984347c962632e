"""What this link has taught so far: many simple rules run side by side, and the best one leads.

Each rule is one of "rent or buy". Its signal shows whether the link looks bad at this moment. A rule in the cloud under
a bad signal gains regret at the price of exposed seconds; a rule on the robot under a good signal gains it at the price
of wasted seconds. Otherwise regret falls at the same rate. A rule moves when its regret reaches `out` or `back` prices
of a switch. Some rules leave at the first sign of trouble, others bear it for a second; some return at once, others
wait long. Some have a memory: on the robot their signal stays bad while too many of the last beats were truly bad,
however good the newest one is.

No rule is best on every link, so each is charged with its true cost on this one. Whether the link was good enough at a
moment is known one limit later: a message sent at that moment has come back by then, or not. Old charges weigh less. A
rule starts with a handicap learned on other links (prior.py), and must beat the leader by a margin to replace it.

The lengths of the last bad and good spells are kept too, to show people what a rule waits for.

The state is immutable like that of the other machines. Time goes in ticks of one beat period; while the link is good
and every rule is in the cloud, a tick costs next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.link.prior import MEMORIES, PRIOR
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Settings

EXPOSED_PER_S = 10.0
"""Cost of a second in the cloud on a bad link."""
WASTED_PER_S = 1.0
"""Cost of a second on the robot beside a good link."""
SWITCH = 0.5
"""Cost of a change of side."""
SILENT_BEATS = 2.25
"""A signal is bad after this many beat periods of silence: one lost beat is normal."""
UNKNOWN_BEATS = 2.25
"""A beat without an echo was lost, unless one of the next two beats was echoed in time."""
REVIEW_TICKS = 10
"""Ticks between two reviews, in which charges melt and the leader is chosen again."""
STALL_TICKS = 5
"""After a stall of this process longer than this, nothing is learned from that time."""
KEPT_SPELLS = 31
ROUNDING = 1e-9


@dataclass(frozen=True)
class Figures:
    """Figures for choosing the leader (`robot-offload simulate --tune` searches for good ones).

    Attributes:
        handicap: price of being e times as expensive as the best rule on other links.
        margin: a rule must be cheaper than the leader by this to replace it: that may cost a change of side.
        half_life_s: time after which a charge weighs half.
    """

    handicap: float = 3.0
    margin: float = 1.0
    half_life_s: float = 1000.0


@dataclass(frozen=True)
class Expert:
    """A rule.

    Attributes:
        share: share of the limit above which a latency is bad for the rule.
        out, back: regret at which the rule leaves the cloud and returns, as a price.
        memory: which of `MEMORIES` keeps it on the robot, counted from 1; 0 for none.
        learnt: its cost on other links, as the logarithm of a multiple of the best rule's.
    """

    share: float
    out: float
    back: float
    memory: int
    learnt: float


EXPERTS: tuple[Expert, ...] = tuple(
    Expert(share, out * SWITCH, back * SWITCH, memory, learnt) for share, out, back, memory, learnt in PRIOR
)
SHARES: tuple[float, ...] = tuple(sorted({expert.share for expert in EXPERTS}))
SIGNAL: tuple[int, ...] = tuple(SHARES.index(expert.share) for expert in EXPERTS)
EVERYBODY = (1 << len(EXPERTS)) - 1
NOBODY = 0
FIRST = min(range(len(EXPERTS)), key=lambda index: EXPERTS[index].learnt)
LONGEST_MEMORY_S = max(window_s for window_s, _ in MEMORIES)
"""Longest window of the rules that remember."""
LONGEST_WAIT_S = max(expert.back for expert in EXPERTS) / WASTED_PER_S + LONGEST_MEMORY_S
"""On a link that stays good, every rule is in the cloud after this time plus the limit after which truth is known."""
ZEROS = (0.0,) * len(EXPERTS)


@dataclass(frozen=True)
class Spells:
    """Lengths of the last spells in which the link was good enough or not, as known afterwards.

    Attributes:
        good: the present spell is a good one; None before the first.
        since_s: when it began, on the robot's steady clock.
        good_s, bad_s: lengths of the last finished spells.
    """

    good: bool | None = None
    since_s: float = 0.0
    good_s: tuple[float, ...] = ()
    bad_s: tuple[float, ...] = ()


NO_SPELLS = Spells()
USUAL = Figures()


@dataclass(frozen=True)
class LinkState:
    """What the link looks like at one moment.

    Attributes:
        latency_s: present loop latency; inf if unknown.
        silent_s: time since the last beat was heard; inf if none was.
        bad: the link is not good enough, for any reason.
    """

    latency_s: float
    silent_s: float
    bad: bool


@dataclass(frozen=True)
class Outlook:
    """State of all rules. Times on the robot's steady clock, seconds; sets of rules as the bits of an integer.

    Attributes:
        ticked_s: time of the last tick; None before the first beat was heard.
        clouds: rules that are in the cloud.
        regrets: of each rule.
        charges: what each rule has cost, melting.
        pending: (tick, rules in the cloud then) of the ticks whose truth is not known yet, oldest first.
        recent: ticks whose truth is known, as far back as the longest memory: one bit each, 1 for bad, newest last.
        leader: index of the rule that is followed.
        ticks: number since the last review.
        spells: see Spells.
        figures: see Figures.
    """

    ticked_s: float | None = None
    clouds: int = NOBODY
    regrets: tuple[float, ...] = ZEROS
    charges: tuple[float, ...] = ZEROS
    pending: tuple[tuple[float, int], ...] = ()
    recent: int = 0
    leader: int = FIRST
    ticks: int = 0
    spells: Spells = NO_SPELLS
    figures: Figures = USUAL


def in_cloud(outlook: Outlook) -> bool:
    """Return whether the leader is in the cloud."""
    return bool(outlook.clouds >> outlook.leader & 1)


def looks_bad(outlook: Outlook, seen: LinkState, settings: Settings) -> bool:
    """Return whether the leader's signal is bad."""
    return _signals(seen, settings)[SIGNAL[outlook.leader]]


def wait_s(outlook: Outlook) -> float:
    """Return how long the leader waits until it moves, if its signal stays as it must for that."""
    expert, regret = EXPERTS[outlook.leader], outlook.regrets[outlook.leader]
    if in_cloud(outlook):
        return max(0.0, expert.out - regret) / EXPOSED_PER_S
    return max(0.0, expert.back - regret) / WASTED_PER_S


def usual_s(lengths_s: tuple[float, ...]) -> float | None:
    """Return the median length of the spells; None for fewer than three."""
    return sorted(lengths_s)[len(lengths_s) // 2] if len(lengths_s) >= 3 else None


def heard(outlook: Outlook, sent_s: float, latency_s: float, settings: Settings) -> Outlook:
    """Take an echo, which shows how good the link truly was until its beat was sent."""
    pending = outlook.pending
    if not pending or pending[0][0] > sent_s + ROUNDING:
        return outlook
    lost_before_s = sent_s - UNKNOWN_BEATS * settings.beat_period_s
    good = latency_s <= settings.allowed_loop_s
    known = 0
    while known < len(pending) and pending[known][0] <= sent_s + ROUNDING:
        known += 1
    period_s = settings.beat_period_s
    for at_s, clouds in pending[:known]:
        outlook = _charge(outlook, at_s, clouds, good and at_s > lost_before_s, period_s)
    return replace(outlook, pending=pending[known:])


def advance(outlook: Outlook, seen: LinkState, settings: Settings, now_s: float) -> Outlook:
    """Run the rules until now; since the last call the link has looked like `seen`."""
    period_s = settings.beat_period_s
    if outlook.ticked_s is None:
        return outlook if seen.silent_s > settings.loss_timeout_s else replace(outlook, ticked_s=now_s)
    if now_s - outlook.ticked_s > STALL_TICKS * period_s:
        return replace(outlook, ticked_s=now_s, pending=())
    while (at_s := (outlook.ticked_s or 0.0) + period_s) <= now_s + ROUNDING:
        outlook = _tick(_overdue(outlook, at_s, settings), seen, settings, at_s)
    return outlook


def _overdue(outlook: Outlook, now_s: float, settings: Settings) -> Outlook:
    """Charge ticks as bad whose beats can no longer come back in time."""
    wait_s = settings.allowed_loop_s + UNKNOWN_BEATS * settings.beat_period_s
    while outlook.pending and now_s - outlook.pending[0][0] > wait_s:
        (at_s, clouds), *rest = outlook.pending
        outlook = _charge(outlook, at_s, clouds, False, settings.beat_period_s)
        outlook = replace(outlook, pending=tuple(rest))
    return outlook


def _charge(outlook: Outlook, at_s: float, clouds: int, good: bool, period_s: float) -> Outlook:
    spells = outlook.spells
    if outlook.recent or not good:
        known = (1 << round(LONGEST_MEMORY_S / period_s)) - 1
        outlook = replace(outlook, recent=(outlook.recent << 1 | (not good)) & known)
    if spells.good is not good:
        outlook = replace(outlook, spells=_turned(spells, good, at_s))
    wrong = EVERYBODY & ~clouds if good else clouds
    if not wrong:
        return outlook
    price = (WASTED_PER_S if good else EXPOSED_PER_S) * period_s
    charges = [each + price if wrong >> index & 1 else each for index, each in enumerate(outlook.charges)]
    return replace(outlook, charges=tuple(charges))


def _turned(spells: Spells, good: bool, at_s: float) -> Spells:
    if spells.good is None:
        return Spells(good, at_s)
    length_s = at_s - spells.since_s
    if spells.good:
        return replace(spells, good=good, since_s=at_s, good_s=(*spells.good_s[-KEPT_SPELLS + 1 :], length_s))
    return replace(spells, good=good, since_s=at_s, bad_s=(*spells.bad_s[-KEPT_SPELLS + 1 :], length_s))


def _tick(outlook: Outlook, seen: LinkState, settings: Settings, at_s: float) -> Outlook:
    period_s = settings.beat_period_s
    lost = seen.silent_s > settings.loss_timeout_s
    bad = _signals(seen, settings)
    if lost or outlook.clouds != EVERYBODY or any(bad) or any(outlook.regrets):
        outlook = _live(outlook, bad, _remembered(outlook, period_s), lost, period_s)
    ticks = outlook.ticks + 1
    outlook = replace(outlook, ticked_s=at_s, pending=(*outlook.pending, (at_s, outlook.clouds)), ticks=ticks)
    return _review(outlook, period_s) if ticks >= REVIEW_TICKS else outlook


def _signals(seen: LinkState, settings: Settings) -> list[bool]:
    """Return whether the link looks bad, for each share of the limit."""
    limit_s = settings.allowed_loop_s
    silent = seen.silent_s > SILENT_BEATS * settings.beat_period_s
    return [seen.bad or silent or seen.latency_s > share * limit_s for share in SHARES]


def _remembered(outlook: Outlook, period_s: float) -> list[bool]:
    """Return for each memory whether it keeps its rules on the robot; the first entry is for rules without memory."""
    held = [False]
    for window_s, share in MEMORIES:
        beats = round(window_s / period_s)
        held.append(bin(outlook.recent & ((1 << beats) - 1)).count("1") > share * beats)
    return held


def _live(outlook: Outlook, bad: list[bool], remembered: list[bool], lost: bool, period_s: float) -> Outlook:
    """Run every rule for one tick. The hard limit applies to all of them."""
    out_step, back_step = EXPOSED_PER_S * period_s, WASTED_PER_S * period_s
    regrets, clouds, moved = list(outlook.regrets), outlook.clouds, NOBODY
    if lost:
        moved, clouds = clouds, NOBODY
    for index, expert in enumerate(EXPERTS):
        bit = 1 << index
        if moved & bit:
            regrets[index] = 0.0
        elif clouds & bit:
            if not bad[SIGNAL[index]]:
                regrets[index] = max(0.0, regrets[index] - out_step)
            elif regrets[index] + out_step >= expert.out - ROUNDING:
                regrets[index], moved = 0.0, moved | bit
            else:
                regrets[index] += out_step
        elif bad[SIGNAL[index]] or lost or remembered[expert.memory]:
            regrets[index] = max(0.0, regrets[index] - back_step)
        elif regrets[index] + back_step >= expert.back - ROUNDING:
            regrets[index], moved = 0.0, moved | bit
        else:
            regrets[index] += back_step
    charges = outlook.charges
    if moved:
        charges = tuple([each + SWITCH if moved >> index & 1 else each for index, each in enumerate(charges)])
        clouds = outlook.clouds ^ moved
    return replace(outlook, regrets=tuple(regrets), clouds=clouds, charges=charges)


def _review(outlook: Outlook, period_s: float) -> Outlook:
    """Let charges melt and choose the leader."""
    figures = outlook.figures
    melted = 0.5 ** (outlook.ticks * period_s / figures.half_life_s)
    charges = tuple([each * melted for each in outlook.charges])
    prices = [each + figures.handicap * expert.learnt for each, expert in zip(charges, EXPERTS, strict=True)]
    best = min(prices)
    leader = prices.index(best) if best + figures.margin < prices[outlook.leader] else outlook.leader
    return replace(outlook, charges=charges, leader=leader, ticks=0)
