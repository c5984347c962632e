"""Where to act when both sides can: link health in, verdict out.

Everything is counted in one currency: a second in the cloud while the link is not good enough costs 10, a second on the
robot while it is costs 1, a change of side 0.5. Two patiences follow from that. In the cloud a slow link is borne for a
short while before the robot acts; on the robot the link must hold for a while before the cloud acts again. Both begin
short and learn from what a move came to: one that turns out wrong doubles its patience, one that turns out right halves
it.

* Leaving was wrong when the link was good again before a change there and back had paid (1 s): a short slow phase,
  better borne. Many links have one every few seconds.
* Returning was wrong when the stay brought less than a change there and back costs: a flap. A stay of `flap_window_s`
  or longer is none.

To wait for as long as the other choice would cost, and to double what was too short, are the classic answers to "rent
or buy" without knowing the future (Karlin, Manasse, Rudolph, Sleator: Competitive snoopy caching, 1988). Broken hard
limits (loss of beats and the like, health.py) end a stay at once; nobody asks here.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.change import replace
from robot_offload_core.settings import Settings
from robot_offload_core.token import Site

ROUNDING_S = 1e-6
"""Less than this is left of a wait only because sums of floats are not exact."""


@dataclass(frozen=True)
class Verdict:
    """A decision with its reason (CamelCase, for machines) and message (for people)."""

    site: Site
    reason: str
    message: str


@dataclass(frozen=True)
class Fitness:
    """Whether the cloud is good enough at this moment, and why (not)."""

    ok: bool
    reason: str
    message: str


@dataclass(frozen=True)
class Rule:
    """The figures of the rule. They were found by replaying recorded links (`robot-offload simulate --tune`).

    Attributes:
        exposed_per_s: price of a second in the cloud while the link is not good enough.
        wasted_per_s: price of a second on the robot while it is.
        switch: price of a change of side.
        patience_s: bad time to be borne after leaving was wrong for the first time; before that it is a beat period.
        patience_max_s: most bad time that is ever borne.
        proof_max_s: longest unbroken good time that a return needs. What a hold-down has more runs on the clock, good
            or bad: a link that is never good for so long would never be used again otherwise.
    """

    exposed_per_s: float = 10.0
    wasted_per_s: float = 1.0
    switch: float = 0.5
    patience_s: float = 0.2
    patience_max_s: float = 0.5
    proof_max_s: float = 2.0

    @property
    def there_and_back(self) -> float:
        """Price of leaving a side and returning to it."""
        return 2 * self.switch


@dataclass(frozen=True)
class Policy:
    """State of the rule. Times on the robot's steady clock, seconds.

    Attributes:
        updated_s: when it was last reckoned; None before the first time.
        good_s: how long the link has been good without a break.
        bad_s: bad time of the present stay in the cloud that still weighs; good time makes it melt.
        gained: what the present stay in the cloud has brought so far, less what it has exposed.
        entered_s: when that stay began; None when there is none, or it has been judged.
        patience_s: bad time to be borne; 0 means a beat period.
        hold_down_s: the wait before the next return; 0 after a stay that paid.
        hold_until_s: the cloud is not used before this.
        chose_to_leave: the rule said that the cloud be left; the return will show whether that was right.
        rule: the figures.
    """

    updated_s: float | None = None
    good_s: float = 0.0
    bad_s: float = 0.0
    gained: float = 0.0
    entered_s: float | None = None
    patience_s: float = 0.0
    hold_down_s: float = 0.0
    hold_until_s: float = 0.0
    chose_to_leave: bool = False
    rule: Rule = Rule()


ROBOT_PREFERRED = Verdict(Site.ROBOT, "RobotPreferred", "The robot is preferred and able to act")
CLOUD_PREFERRED = Verdict(Site.CLOUD, "CloudPreferred", "The link is good enough for the cloud")
LINK_GOOD = Verdict(Site.CLOUD, "LinkGood", "The link has been good for long enough")


def entered(policy: Policy, site: Site, now_s: float) -> Policy:
    """Placement changed to `site`. A return to the cloud shows whether leaving it was right."""
    policy = replace(policy, updated_s=now_s, good_s=0.0, bad_s=0.0)
    if site is Site.ROBOT:
        return policy
    rule, patience_s = policy.rule, policy.patience_s
    if policy.chose_to_leave:
        wrong = (now_s - policy.hold_until_s) * rule.wasted_per_s < rule.there_and_back
        patience_s = _learned(patience_s, wrong, rule.patience_s, rule.patience_max_s)
    return replace(policy, patience_s=patience_s, chose_to_leave=False, gained=0.0, entered_s=now_s)


def lost(policy: Policy, settings: Settings, now_s: float) -> Policy:
    """The stay in the cloud is over, by a loss or because the rule said so: it shows whether returning was right."""
    hold_down_s = policy.hold_down_s
    if policy.entered_s is not None:
        short = now_s - policy.entered_s < settings.flap_window_s
        flap = short and policy.gained < policy.rule.there_and_back
        hold_down_s = _learned(hold_down_s, flap, settings.hold_down_initial_s, settings.hold_down_max_s)
    return replace(policy, hold_down_s=hold_down_s, hold_until_s=now_s + hold_down_s, entered_s=None)


def decide(policy: Policy, site: Site, fitness: Fitness, settings: Settings, now_s: float) -> tuple[Policy, Verdict]:
    """Reckons the time since the last call to `site` (where we were) and says where to be."""
    policy = _reckon(policy, site, fitness.ok, now_s)
    if settings.prefer is Site.ROBOT:
        return policy, ROBOT_PREFERRED
    if site is Site.ROBOT:
        return policy, _on_robot(policy, fitness, settings, now_s)
    verdict = _in_cloud(policy, fitness, settings)
    # Once said it stands until the return, unless we did not get away and what was bad has melted.
    chose = verdict.site is Site.ROBOT or (policy.chose_to_leave and policy.bad_s > 0)
    return policy if chose is policy.chose_to_leave else replace(policy, chose_to_leave=chose), verdict


def _reckon(policy: Policy, site: Site, ok: bool, now_s: float) -> Policy:
    passed_s = 0.0 if policy.updated_s is None else max(0.0, now_s - policy.updated_s)
    good_s = policy.good_s + passed_s if ok else 0.0
    if site is Site.ROBOT:
        return replace(policy, updated_s=now_s, good_s=good_s)
    rule = policy.rule
    if ok:
        gained = policy.gained + rule.wasted_per_s * passed_s
        bad_s = max(0.0, policy.bad_s - passed_s * rule.wasted_per_s / rule.exposed_per_s)
    else:
        gained = policy.gained - rule.exposed_per_s * passed_s
        bad_s = policy.bad_s + passed_s
    return replace(policy, updated_s=now_s, good_s=good_s, gained=gained, bad_s=bad_s)


def _in_cloud(policy: Policy, fitness: Fitness, settings: Settings) -> Verdict:
    if fitness.ok:
        return CLOUD_PREFERRED
    left_s = max(policy.patience_s, settings.beat_period_s) - policy.bad_s
    if left_s > ROUNDING_S:
        return Verdict(Site.CLOUD, "CloudPreferred", f"{fitness.message}, borne for another {left_s * 1e3:.0f} ms")
    return Verdict(Site.ROBOT, fitness.reason, fitness.message)


def _on_robot(policy: Policy, fitness: Fitness, settings: Settings, now_s: float) -> Verdict:
    if not fitness.ok:
        return Verdict(Site.ROBOT, fitness.reason, fitness.message)
    left_s = policy.hold_until_s - now_s
    if left_s > ROUNDING_S:
        return Verdict(Site.ROBOT, "HoldDown", f"The link is back, hold-down for another {left_s:.1f} s")
    proof_s = max(settings.beat_period_s, min(policy.hold_down_s, policy.rule.proof_max_s))
    left_s = proof_s - policy.good_s
    if left_s > ROUNDING_S:
        return Verdict(Site.ROBOT, "Proving", f"The link is good and must stay so for another {left_s * 1e3:.0f} ms")
    return LINK_GOOD


def _learned(patience_s: float, wrong: bool, first_s: float, most_s: float) -> float:
    """A patience after a move that it led to: doubled (from `first_s`, up to `most_s`), or halved (below that 0)."""
    if wrong:
        return min(most_s, max(first_s, 2 * patience_s))
    return patience_s / 2 if patience_s / 2 >= first_s else 0.0
