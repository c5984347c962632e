"""Cuts in both directions with other standbys, heartbeats and links; the rivals beside, over a link like it."""

from __future__ import annotations

import dataclasses
import random
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis import alarms, cuts, detect
from robot_offload_lab.bench.analysis.alarms import QuietStretch
from robot_offload_lab.bench.analysis.cuts import Cut
from robot_offload_lab.bench.analysis.detect import Judged, Variant
from robot_offload_lab.bench.groups.silence import BAD as BAD_CASE
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.resource import BenchCase, Sensor
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.rivals import RIVALS, RivalReport
from robot_offload_lab.bench.stage import Stage
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.two_hosts import TwoHosts

REST_S: Final = (1.0, 1.4)
LONG_S: Final = 5.0
"""Longer than a bond's patience."""
SHORT_S: Final = 1.5
LONGER_S: Final = 0.4
BACK_PATIENCE_S: Final = 30.0
PREFIX: Final = "detect-"
WATCHER: Final = "rival-watcher"


@dataclass(frozen=True)
class DetectionRun:
    """One case.

    Attributes:
        case: link, standby, heartbeat.
        cut_s: length of the cuts.
        quiet: whether it is watched without a cut before them.
    """

    case: BenchCase
    heartbeat_ms: int
    silence_ms: int
    cut_s: float = SHORT_S
    quiet: bool = False

    @property
    def name(self) -> str:
        """A word."""
        return self.case.name.removeprefix(PREFIX)

    @property
    def variant(self) -> Variant:
        """For people."""
        words = f"{self.case.standby} standby, beats every {self.heartbeat_ms} ms"
        return Variant(self.name, words, self.case.describe())


def _run(name: str, heartbeat_ms: int, silence_ms: int, lease_ms: int, standby: str = "Warm") -> BenchCase:
    settings = {"heartbeatPeriod": heartbeat_ms, "lossTimeout": silence_ms, "lease": lease_ms}
    return BenchCase(
        f"{PREFIX}{name}", LinkOptions(delay="5ms"), standby=standby,
        switching=tuple((key, f"{value}ms") for key, value in settings.items()),
    )  # fmt: skip


BAD: Final = dataclasses.replace(
    BAD_CASE, name=f"{PREFIX}bad", sensors=(Sensor("odom", (64,), 1000),), output=(("deadline", "400ms"),)
)
RUNS: Final = (
    DetectionRun(_run("warm", 20, 90, 250), 20, 90, LONG_S, quiet=True),
    DetectionRun(_run("hot", 20, 90, 250, "Hot"), 20, 90),
    DetectionRun(_run("slow", 50, 225, 400), 50, 225),
    DetectionRun(BAD, 20, 90, quiet=True),
)
MORE: Final = (
    DetectionRun(_run("fast", 10, 45, 250), 10, 45, quiet=True),
    DetectionRun(_run("fast-hot", 10, 45, 250, "Hot"), 10, 45),
)
"""Only in the long form."""
CASES: Final = tuple(one.name for one in (*RUNS, *MORE))


def runs(amounts: Amounts) -> tuple[DetectionRun, ...]:
    """Return the cases of a form."""
    return RUNS if amounts.form == "short" else (*RUNS, *MORE)


def run(order: Order) -> GroupResult:
    """Measure one case after the other, each with its rivals where this machine can run them."""
    refused = TwoHosts.refusal()
    known = (*RUNS, *MORE) if order.cases else runs(order.amounts)
    wanted = [one for one in known if order.wants(one.name)]
    found = [_measure(order, one, rivals=not refused) for one in wanted]
    return detect.outcome(order.priority, found, refused)


class _Rivals:
    """The rivals of a run, over a link of their own."""

    def __init__(self, stack: ExitStack, order: Order, one: DetectionRun, limit_s: float) -> None:
        self.cuts: list[Cut] = []
        self._one = one
        self._hosts = stack.enter_context(TwoHosts(one.case.link, order.seed))
        folder = order.folder(f"{one.case.name}-rivals")
        stage = Stage(folder, realtime=order.realtime, domain=order.domain, hosts=self._hosts)
        self._stage = stack.enter_context(stage)
        part = "robot_offload_lab.bench.parts.rival"
        patience_s = one.silence_ms / 1e3
        stage.start(WATCHER, f"{part}_watcher", "--patience", patience_s, "--limit", limit_s, host="robot")
        stage.start("rival-sender", f"{part}_sender", "--period", one.heartbeat_ms / 1e3, host="cloud")

    @property
    def reports(self) -> tuple[RivalReport, ...]:
        """Everything so far."""
        return tuple(RivalReport(**said) for said in self._stage.said[WATCHER])

    def until_back(self) -> None:
        """Wait until every rival reports that the cloud is there."""
        self._stage.until(self._all_back, "the rivals find the other host", BACK_PATIENCE_S)

    def _all_back(self) -> bool:
        newest = {report.rival: report.lost for report in self.reports}
        return all(newest.get(rival.name) is False for rival in RIVALS)

    def cut(self, which: str | None) -> float:
        """Cut or restore the link; return the moment."""
        before_s = steady_s()
        self._hosts.cut("both" if which else None)
        return steady_s() if which else before_s

    def judged(self, quiet: Interval | None) -> list[Judged]:
        """Return the result of each."""
        self._stage.follow()
        return [detect.rival(kind, self.reports, self.cuts, quiet) for kind in RIVALS]


def _measure(order: Order, one: DetectionRun, *, rivals: bool) -> detect.DetectionAccount:
    chance = random.Random(order.seed)
    with ExitStack() as stack:
        limit_s = (one.case.robot_period_ms + one.case.tolerance_ms - 1e3 / one.case.cloud_rate_hz) / 1e3
        beside = _Rivals(stack, order, one, limit_s) if rivals else None
        world = stack.enter_context(MeasuredSystem(one.case, order.setting(one.case.name)))
        if beside is not None:
            beside.until_back()
        quiet = _quiet(world, order.amounts.quiet_s) if one.quiet else None
        done = [_cut(world, beside, one, number, chance) for number in range(order.amounts.detections)]
        evidence = world.finish()
        judged = beside.judged(quiet) if beside is not None else []
        switching = world.system.spec.switching
    account = cuts.CutAccount(
        cuts=tuple(done),
        recording=evidence.recording,
        robot=evidence.robot,
        lease=(),
        loop_limit_s=(switching.loss_timeout_ms + switching.latency.allowed_loop_ms) / 1e3,
        lease_s=switching.lease_ms / 1e3,
    )
    sudden = None
    if quiet is not None:
        sudden = sum(leave.sudden for leave in alarms.leaves(QuietStretch(quiet.start_s, quiet.end_s, evidence.robot)))
    return detect.DetectionAccount(one.variant, quiet, (detect.ours(cuts.falls(account), sudden), *judged))


def _quiet(world: MeasuredSystem, seconds: float) -> Interval:
    start_s = steady_s()
    world.rest(seconds)
    return Interval(start_s, steady_s())


def _cut(world: MeasuredSystem, beside: _Rivals | None, one: DetectionRun, number: int, chance: random.Random) -> Cut:
    """Cut both links at the same moment; each has its own time stamp."""
    world.rest(chance.uniform(*REST_S))
    world.until(lambda: world.site == "cloud", "the cloud is in charge before a cut")
    _, cut_s = world.cut("both")
    theirs_s = beside.cut("both") if beside is not None else 0.0
    world.rest(one.cut_s + chance.uniform(0.0, LONGER_S))
    healed_s, _ = world.cut(None)
    if beside is not None:
        beside.cuts.append(Cut(number, "both", one.cut_s, theirs_s, beside.cut(None)))
    world.until(lambda: world.site == "cloud", "the cloud is in charge again after a cut")
    if beside is not None:
        beside.until_back()
    return Cut(number, "both", one.cut_s, cut_s, healed_s)
