"""Choose the side when both could be active: link health in, verdict out.

All costs have one unit. A second in the cloud while the link is not good enough costs 10, a second on the robot while
it is good enough costs 1, a change of side 0.5. The cheapest rule depends on the link: with short stalls it is best to
stay, with long outages to leave at once and return late. So the outlook (experts.py) runs many rules on this link, and
the policy follows the best one.

Two things are added. The cloud is never entered over a link that is not good enough at that moment, whatever a patient
rule chooses. And a wrong return is followed by a hold-down: a stay is a flap if it gained less than a change there and
back costs and was shorter than `flap_window_s`. Each flap doubles the wait before the next return, up to the user's
limit; a stay that paid halves it. A link that was good for 4 s without a break ends the wait.

Broken hard limits (loss of beats and the like, health.py) end a stay at once, without asking the policy.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Site
from robot_offload_core.link import experts
from robot_offload_core.link.experts import EXPOSED_PER_S, SWITCH, WASTED_PER_S, LinkState, Outlook
from robot_offload_core.link.links import Link
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Settings

THERE_AND_BACK = 2 * SWITCH
"""Price of leaving a side and returning to it."""
PROVEN_S = 4.0
"""A link that was good for this long without a break ends every hold-down."""
UNTAUGHT = Outlook()
ROUNDING_S = 1e-6
"""A remaining wait below this is only a rounding error of summed floats."""


@dataclass(frozen=True)
class Fitness:
    """Whether the cloud is good enough at this moment, and why (not).

    Attributes:
        ok: the loop is fast enough.
        reason, message: why (not).
        latency_s: present loop latency; inf if unknown.
        silent_s: time since anything was heard from the cloud.
    """

    ok: bool
    reason: Reason
    message: str
    latency_s: float = 0.0
    silent_s: float = 0.0


@dataclass(frozen=True)
class Policy:
    """State of the policy. Times on the robot's steady clock, seconds.

    Attributes:
        updated_s: when the state was last updated; None before the first time.
        good_s: how long the link has been good without a break.
        bad_s: how long it has been bad without a break.
        gained: gain of the present stay in the cloud so far, less the cost of its exposed seconds.
        entered_s: when that stay began; None if there is none, or it has been judged.
        hold_down_s: the wait before the next return; 0 after a stay that paid.
        hold_until_s: the cloud is not used before this time.
        outlook: what this link has taught.
    """

    updated_s: float | None = None
    good_s: float = 0.0
    bad_s: float = 0.0
    gained: float = 0.0
    entered_s: float | None = None
    hold_down_s: float = 0.0
    hold_until_s: float = 0.0
    outlook: Outlook = UNTAUGHT


ROBOT_PREFERRED = Verdict(Site.ROBOT, Reason.ROBOT_PREFERRED, "The robot is preferred and able to act")
CLOUD_PREFERRED = Verdict(Site.CLOUD, Reason.CLOUD_PREFERRED, "The link is good enough for the cloud")


def heard(policy: Policy, sent_s: float, latency_s: float, settings: Settings) -> Policy:
    """Take a beat sent at `sent_s` that was echoed after a loop latency of `latency_s`."""
    outlook = experts.heard(policy.outlook, sent_s, latency_s, settings)
    return policy if outlook is policy.outlook else replace(policy, outlook=outlook)


def echoed(policy: Policy, before: Link, link: Link, settings: Settings) -> Policy:
    """Take the change of the link from `before` to `link` by a beat of the cloud, which may hold a new echo."""
    sent_s, round_trip_s = link.echo_sent_s, link.round_trip_s
    if sent_s is None or round_trip_s is None or sent_s == before.echo_sent_s:
        return policy
    return heard(policy, sent_s, round_trip_s, settings)


def entered(policy: Policy, site: Site, now_s: float) -> Policy:
    """Take a change of the active side to `site`: count anew how long the link is good or bad."""
    policy = replace(policy, updated_s=now_s, good_s=0.0, bad_s=0.0)
    return policy if site is Site.ROBOT else replace(policy, gained=0.0, entered_s=now_s)


def lost(policy: Policy, settings: Settings, now_s: float) -> Policy:
    """End the stay in the cloud, after a loss or by the rule, and judge whether returning was right."""
    hold_down_s = policy.hold_down_s
    if policy.entered_s is not None:
        short = now_s - policy.entered_s < settings.flap_window_s
        flap = short and policy.gained < THERE_AND_BACK
        hold_down_s = _learned(hold_down_s, flap, settings.hold_down_initial_s, settings.hold_down_max_s)
    return replace(policy, hold_down_s=hold_down_s, hold_until_s=now_s + hold_down_s, entered_s=None)


def flapped(policy: Policy, settings: Settings, now_s: float) -> Policy:
    """Lengthen the wait before the next return after several short stays, whatever each of them gained."""
    hold_down_s = _learned(policy.hold_down_s, True, settings.hold_down_initial_s, settings.hold_down_max_s)
    return replace(policy, hold_down_s=hold_down_s, hold_until_s=now_s + hold_down_s, entered_s=None)


def decide(policy: Policy, site: Site, fitness: Fitness, settings: Settings, now_s: float) -> tuple[Policy, Verdict]:
    """Count the time since the last call for `site` (the side active meanwhile), and return the side to use."""
    policy = _reckon(policy, site, fitness, settings, now_s)
    if settings.prefer is Site.ROBOT:
        return policy, ROBOT_PREFERRED
    if site is Site.ROBOT:
        return policy, _on_robot(policy, fitness, settings, now_s)
    return policy, _in_cloud(policy, fitness, settings)


def waits(policy: Policy) -> bool:
    """Return whether the outlook still waits before it returns to the cloud over a good link."""
    return not experts.in_cloud(policy.outlook)


def _reckon(policy: Policy, site: Site, fitness: Fitness, settings: Settings, now_s: float) -> Policy:
    passed_s = 0.0 if policy.updated_s is None else max(0.0, now_s - policy.updated_s)
    ok = fitness.ok
    gained = policy.gained
    if site is Site.CLOUD:
        gained += WASTED_PER_S * passed_s if ok else -EXPOSED_PER_S * passed_s
    return replace(
        policy, updated_s=now_s, good_s=policy.good_s + passed_s if ok else 0.0,
        bad_s=0.0 if ok else policy.bad_s + passed_s, gained=gained,
        outlook=experts.advance(policy.outlook, _seen(fitness), settings, now_s),
    )  # fmt: skip


def _in_cloud(policy: Policy, fitness: Fitness, settings: Settings) -> Verdict:
    """Leave if the outlook has left and the link looks bad to it; an outlook that only waits ends no stay."""
    outlook = policy.outlook
    if not experts.in_cloud(outlook):
        if not fitness.ok:
            return Verdict(Site.ROBOT, fitness.reason, fitness.message)
        usual = _usual(outlook.spells.good_s, "good spells")
        if experts.looks_bad(outlook, _seen(fitness), settings):
            overdue = fitness.silent_s > settings.beat_period_s * experts.SILENT_BEATS
            silent = f"No heartbeat for {fitness.silent_s * 1e3:.0f} ms"
            message = silent if overdue else f"{fitness.message}, and it gets worse"
            return Verdict(Site.ROBOT, Reason.LINK_UNSTEADY, message + usual)
    if fitness.ok:
        return CLOUD_PREFERRED
    left_ms = experts.wait_s(outlook) * 1e3
    usual = _usual(outlook.spells.bad_s, "slow spells")
    return Verdict(Site.CLOUD, Reason.CLOUD_PREFERRED, f"{fitness.message}{usual}: borne for another {left_ms:.0f} ms")


def _on_robot(policy: Policy, fitness: Fitness, settings: Settings, now_s: float) -> Verdict:
    if not fitness.ok:
        return Verdict(Site.ROBOT, fitness.reason, fitness.message)
    left_s = min(policy.hold_until_s - now_s, PROVEN_S - policy.good_s)
    if left_s > ROUNDING_S:
        return Verdict(Site.ROBOT, Reason.HOLD_DOWN, f"The link is back, hold-down for another {left_s:.1f} s")
    outlook = policy.outlook
    left_s = 0.0 if experts.in_cloud(outlook) else experts.wait_s(outlook)
    left_s = max(left_s, settings.beat_period_s - policy.good_s)  # whatever ended the stay shows for a moment
    if left_s > ROUNDING_S:
        usual = _usual(outlook.spells.bad_s, "outages")
        left = f"waiting for another {left_s:.1f} s"
        return Verdict(Site.ROBOT, Reason.PROVING, f"Link good for {policy.good_s:.1f} s{usual}: {left}")
    return Verdict(Site.CLOUD, Reason.LINK_GOOD, f"The link has been good for long enough ({policy.good_s:.1f} s)")


def _seen(fitness: Fitness) -> LinkState:
    return LinkState(fitness.latency_s, fitness.silent_s, not fitness.ok)


def _usual(lengths_s: tuple[float, ...], name: str) -> str:
    """Return the median length of such spells as part of a sentence; "" while too few are known."""
    usual_s = experts.usual_s(lengths_s)
    if usual_s is None:
        return ""
    return f"; {name} here last {usual_s:.1f} s in the median"


def _learned(patience_s: float, wrong: bool, first_s: float, most_s: float) -> float:
    """Return the new wait after a stay: doubled (`first_s` to `most_s`) if wrong, else halved (0 below `first_s`)."""
    if wrong:
        return min(most_s, max(first_s, 2 * patience_s))
    return patience_s / 2 if patience_s / 2 >= first_s else 0.0
