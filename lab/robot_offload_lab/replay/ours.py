"""The agents' rule, run through the agents' own code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robot_offload_core.control.robot.health import Circumstances, Situation, fitness
from robot_offload_core.control.robot.limits import cloud_fault
from robot_offload_core.fence.token import Site
from robot_offload_core.link import links, policies
from robot_offload_core.link.experts import Figures, Outlook
from robot_offload_core.link.links import Link
from robot_offload_core.link.policies import Fitness, Policy
from robot_offload_core.words.beats import Beat, CloudReport, Echo
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import Settings

ROBOT: Final = "00000000000000000000000000000001"
CLOUD: Final = "00000000000000000000000000000002"
EPOCH: Final = 1
GATE: Final = GateReport(charge=None, fell_back=False, robot_flows=True, cloud_flows=True)
REPORT: Final = CloudReport(serves=ROBOT, epoch=EPOCH, acting=True, ready=True, data_age_us=0)


@dataclass(frozen=True, slots=True)
class Sight:
    """What the agent knows about the link at one moment.

    Attributes:
        now_s: the moment.
        fitness: whether the loop is fast enough.
        fault: the broken hard limit of the link that forbids the cloud; None when all hold.
        good_s: arrival of the newest good beat; minus infinity before the first.
    """

    now_s: float
    fitness: Fitness
    fault: Verdict | None
    good_s: float


class Eyes:
    """How the agent evaluates echoes: `link.hear`, `health.fitness` and `limits.cloud_fault`.

    Each echo stands for one heartbeat of the cloud, received when the echo is back. So silence is judged slightly too
    severely: when a link slows down in one step, an agent receives the cloud's next heartbeat after half of that step.
    Everything except the link works: data session, collector, nodes and the cloud agent itself.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.link = Link()
        self.good_s = float("-inf")
        self._frame = Circumstances(ROBOT, CLOUD, EPOCH, settings, (), stall_until_s=0.0)
        self._sequence = 0

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Take an echo that came back; the cloud agent sent it half of the round trip ago."""
        self._sequence += 1
        echo = Echo(ROBOT, self._sequence, round(sent_s * 1e6), hold_us=0)
        answered_us = round((sent_s + arrived_s) / 2 * 1e6)
        beat = Beat("", Site.CLOUD, CLOUD, self._sequence, answered_us, 0, 0, echo, REPORT)
        self.link = links.hear(self.link, beat, ROBOT, arrived_s, 0)
        if arrived_s - sent_s <= self.settings.echo_limit_s:
            self.good_s = arrived_s

    def look(self, now_s: float) -> Sight:
        """Return what is known at `now_s`."""
        situation = Situation(
            report=REPORT, control_age_s=0.0, good_s=now_s, pulse_s=now_s, gate=GATE, gate_s=now_s,
            data_connected=True, data_cloud=CLOUD, data_heard_s=now_s, data_s=now_s,
        )  # fmt: skip
        fault = cloud_fault(situation, self.link, self._frame, now_s, acting=True)
        return Sight(now_s, fitness(self.link, self.settings, now_s), fault, self.good_s)


class Mind:
    """How the agent decides from what it knows: `policy.decide`, and the take-over at a broken hard limit.

    Args:
        settings: settings of the agent.
        figures: figures of the outlook; None: the product's.
    """

    def __init__(self, settings: Settings, figures: Figures | None = None) -> None:
        self._settings = settings
        self.policy = Policy() if figures is None else Policy(outlook=Outlook(figures=figures))
        self._site = Site.ROBOT
        self._entered_s = 0.0

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Take an echo that came back: it shows the state of the link when its beat was sent."""
        self.policy = policies.heard(self.policy, sent_s, arrived_s - sent_s, self._settings)

    def place(self, sight: Sight) -> Verdict:
        """Return the decision at that moment, as `switcher.step` would make it if changing over took no time."""
        now_s, site = sight.now_s, self._site
        self.policy, verdict = policies.decide(self.policy, site, sight.fitness, self._settings, now_s)
        if site is Site.CLOUD:
            fault = sight.fault or self._not_good(sight)
            verdict = fault or verdict
            if verdict.site is Site.ROBOT:
                self._enter(Site.ROBOT, policies.lost(self.policy, self._settings, now_s), now_s)
        elif verdict.site is Site.CLOUD and sight.fault is not None:
            verdict = sight.fault
        elif verdict.site is Site.CLOUD:
            self._enter(Site.CLOUD, self.policy, now_s)
        return verdict

    def _enter(self, site: Site, policy: Policy, now_s: float) -> None:
        self.policy = policies.entered(policy, site, now_s)
        self._site, self._entered_s = site, now_s

    def _not_good(self, sight: Sight) -> Verdict | None:
        silent_s = sight.now_s - max(self._entered_s, sight.good_s)
        if silent_s <= self._settings.loss_timeout_s:
            return None
        return Verdict(Site.ROBOT, Reason.CLOUD_NOT_ACTING, "No good heartbeat: each one echoes a beat that is too old")


class Ours:
    """The agent as a policy: changes over at once when `policy.decide` does and no hard limit is broken."""

    def __init__(self, settings: Settings) -> None:
        self._eyes = Eyes(settings)
        self._mind = Mind(settings)

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Take in an echo."""
        self._eyes.heard(sent_s, arrived_s)
        self._mind.heard(sent_s, arrived_s)

    def place(self, now_s: float) -> Verdict:
        """Return what the agent would decide."""
        return self._mind.place(self._eyes.look(now_s))
