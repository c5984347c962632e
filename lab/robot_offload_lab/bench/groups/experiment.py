"""The ten topics of the field's standard experiment, in every scenario that this machine can make.

Robots and pods of a real cluster are measured by the end-to-end bench, not here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.bench import kinds, observed, processor
from robot_offload_lab.bench.analysis import experiment
from robot_offload_lab.bench.analysis.experiment import ExperimentScenario, Travelled
from robot_offload_lab.bench.analysis.share import stays
from robot_offload_lab.bench.kinds import KINDS, RATE_HZ
from robot_offload_lab.bench.observed import Hop, only
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import GroupResult, at_or_none
from robot_offload_lab.bench.stage import Stage
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.judge import recording
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import Arrival, PlacementChange, RunInfo
from robot_offload_lab.run import marked, routed
from robot_offload_lab.run.free import free_domains
from robot_offload_lab.wire.dds_options import Carried, DdsWireConfig
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.two_hosts import CLOUD_ADDRESS, TwoHosts

DELAY_MS: Final = 10.0
LINK: Final = LinkOptions(delay=f"{DELAY_MS:g}ms")
CLEAR: Final = LinkOptions()
ONE_HOST: Final = ExperimentScenario("one_host", "direct DDS, one host", "one host", False, thesis="60 % under 1 ms")
RETURNED: Final = ExperimentScenario("one_host_echo", "direct DDS there and back, one host", "one host", True)
BRIDGE: Final = ExperimentScenario(
    "bridge", "one host, two domains, through the bridge (Zenoh)", "no delay", True, RETURNED.name,
    thesis="a DDS Router adds less than 1 ms",
)  # fmt: skip
TWO_HOSTS: Final = ExperimentScenario(
    "two_hosts", "direct DDS between two hosts", f"{DELAY_MS:g}ms each way", True, RETURNED.name, thesis="LAN 8-9 ms"
)
ZENOH: Final = ExperimentScenario(
    "zenoh", "robot to cloud, Zenoh", f"{DELAY_MS:g}ms each way", True, TWO_HOSTS.name, True,
    thesis="two DDS Routers 100-500 ms",
)  # fmt: skip
ROUTER: Final = ExperimentScenario(
    "router", "robot to cloud, two DDS Routers", f"{DELAY_MS:g}ms each way", True, TWO_HOSTS.name,
    thesis="two DDS Routers 100-500 ms",
)  # fmt: skip
TOPICS: Final = ExperimentScenario(
    "topics", "robot to cloud, topics (StaticPeers)", f"{DELAY_MS:g}ms each way", True, TWO_HOSTS.name
)
PODS: Final = "cloud pods, and every transport of a real cluster"
PODS_WHY: Final = "needs a cluster; `make bench-e2e` measures it"
SETTLE_S: Final = 1.5
LANDING_S: Final = 0.5
RECORDER: Final = "recorder"
EVER: Final = (Interval(float("-inf"), float("inf")),)
PORT: Final = 20999
"""In a network namespace of its own."""


def run(order: Order) -> GroupResult:
    """Measure all scenarios, one after the other."""
    found: list[Travelled] = []
    refused = {}
    for name, (scenario, measure) in RUNS.items():
        try:
            found += measure(order) if order.wants(name) else []
        except RobotOffloadError as error:  # the others are worth having without it
            refused[scenario.title] = error.lines[0]
    if not found:
        raise RobotOffloadError("\n".join(f"{title}: {why}" for title, why in refused.items()))
    return experiment.outcome(order.priority, found, {**refused, PODS: PODS_WHY})


def _bridge(order: Order) -> list[Travelled]:
    return [_through(order, BRIDGE, "Zenoh", CLEAR)]


def _zenoh(order: Order) -> list[Travelled]:
    return [_through(order, ZENOH, "Zenoh", LINK)]


def _router(order: Order) -> list[Travelled]:
    if not routed.binary():
        raise RobotOffloadError(f"needs a DDS Router 3.4.0, whose path {routed.VARIABLE} says")
    return [_through(order, ROUTER, "DDSRouter", LINK)]


def _topics(order: Order) -> list[Travelled]:
    return [_through(order, TOPICS, "StaticPeers", LINK)]


# -- with both agents -------------------------------------------------------------------------------------------------


def _through(order: Order, scenario: ExperimentScenario, transport: str, link: LinkOptions) -> Travelled:
    resource = kinds.offload(transport, 2 * DELAY_MS)
    setting = dataclasses.replace(order.setting(f"experiment-{scenario.name}"), offload=resource, hops=True)
    with MeasuredSystem(BenchCase(scenario.name, link), setting) as world:
        world.rest(SETTLE_S)
        pids, agent = marked.find(world.system.run), world.agent("robot")
        before, agent_before = processor.read(pids), processor.read(agent)
        window = _window(order, world.rest)
        after, agent_after = processor.read(pids), processor.read(agent)
        world.rest(LANDING_S)
        evidence = world.finish()
    charged = stays(only(PlacementChange, evidence.robot), "cloud")
    return _travelled(
        scenario, evidence.recording.outputs, window, charged, evidence.hops,
        (before, after), processor.own_percent(agent_before, agent_after),
    )  # fmt: skip


# -- without ----------------------------------------------------------------------------------------------------------


def _one_host(order: Order) -> list[Travelled]:
    with Stage(order.folder("experiment-one-host"), realtime=order.realtime, domain=order.domain) as stage:
        _start(stage)
        outputs, window, readings = _record(order, stage)
    return [_travelled(scenario, outputs, window, EVER, (), readings) for scenario in (ONE_HOST, RETURNED)]


def _two_hosts(order: Order) -> list[Travelled]:
    """Return network namespaces where that is permitted, otherwise two domains joined by the emulated DDS link."""
    folder = order.folder("experiment-two-hosts")
    if TwoHosts.refusal():
        domains = order.domains or free_domains()
        with Stage(folder, realtime=order.realtime, domain=domains[0]) as stage:
            _start(stage, {"ROS_DOMAIN_ID": str(domains[1])})
            _start_dds_wire(stage, domains, order.seed)
            outputs, window, readings = _record(order, stage)
        named = dataclasses.replace(TWO_HOSTS, title=f"{TWO_HOSTS.title} (two domains, emulated DDS link)")
        return [_travelled(named, outputs, window, EVER, (), readings, own_ms=DELAY_MS)]
    with (
        TwoHosts(LINK, order.seed) as hosts,
        Stage(folder, realtime=order.realtime, domain=order.domain, hosts=hosts) as stage,
    ):
        _start(stage)
        path = stage.folder / "hops.jsonl"
        options = ("--dial", PORT, "--serve", PORT, "--host", CLOUD_ADDRESS, "--period", 0.02)
        spaces = ("--robot-net", hosts.namespace("robot"), "--cloud-net", hosts.namespace("cloud"))
        stage.start("hop", "robot_offload_lab.bench.parts.hop", path, *options, *spaces, 64)
        outputs, window, readings = _record(order, stage)
    return [_travelled(TWO_HOSTS, outputs, window, EVER, observed.read(path), readings)]


def _start(stage: Stage, cloud: Mapping[str, str] | None = None) -> None:
    """Start publishers and subscribers on the robot, and the echo in the cloud."""
    by_itself = ("--ros-args", "-p", "by_itself:=true")
    stage.start("echo", "robot_offload_lab.bench.parts.echo", *by_itself, host="cloud", extra=cloud)
    topics = [f"{topic}={kind.type}" for kind in KINDS for topic in (kind.sent, kind.returned)]
    options = [word for topic in topics for word in ("--topic", topic)]
    path = stage.folder / "recording.jsonl"
    stage.start(RECORDER, "robot_offload_lab.judge.recorder", path, *options, host="robot")
    stage.start("kinds", "robot_offload_lab.bench.parts.kinds_source", host="robot")


def _start_dds_wire(stage: Stage, domains: tuple[int, int], seed: int) -> None:
    carried = [Carried(kind.sent, "up", kind.type, "reliable") for kind in KINDS]
    carried += [Carried(kind.returned, "down", kind.type, "reliable") for kind in KINDS]
    path = stage.folder / "dds-wire.json"
    path.write_text(DdsWireConfig(domains, tuple(carried), LINK, seed).to_json(), encoding="utf-8")
    stage.start("dds-wire", "robot_offload_lab.wire.dds", path)


Recorded = tuple[Mapping[str, Sequence[Arrival]], Interval, tuple[processor.Reading, processor.Reading]]


def _record(order: Order, stage: Stage) -> Recorded:
    """Wait until messages come back on every topic, then record."""
    wanted = {kind.returned for kind in KINDS}
    stage.until(lambda: wanted <= {said.get("topic") for said in stage.said[RECORDER]}, "messages come back")
    stage.rest(SETTLE_S)
    start = RunInfo("bench", order.seed, steady_s(), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    stage.programs.command(RECORDER, {"start": dataclasses.asdict(start)})
    stage.said[RECORDER].clear()
    pids = tuple(stage.programs.pids.values())
    before = processor.read(pids)
    window = _window(order, stage.rest)
    after = processor.read(pids)
    stage.rest(LANDING_S)
    stage.programs.command(RECORDER, {"end": steady_s()})
    stage.end(RECORDER)
    return recording.read(stage.folder / "recording.jsonl").outputs, window, (before, after)


# -- both -------------------------------------------------------------------------------------------------------------


def _window(order: Order, rest: Callable[[float], None]) -> Interval:
    """Let the requested number of messages travel."""
    start_s = steady_s()
    rest(order.amounts.messages / RATE_HZ)
    return Interval(start_s, steady_s())


def _travelled(
    scenario: ExperimentScenario,
    outputs: Mapping[str, Sequence[Arrival]],
    window: Interval,
    within: Sequence[Interval],
    hops: Sequence[observed.Observation],
    readings: tuple[processor.Reading, processor.Reading],
    agent_percent: float | None = None,
    own_ms: float | None = None,
) -> Travelled:
    by_kind = {kind.name: outputs.get(kind.returned if scenario.halved else kind.sent, ()) for kind in KINDS}
    return Travelled(
        scenario=scenario,
        latencies_ms={
            name: tuple(experiment.latencies(arrivals, window, within, halved=scenario.halved))
            for name, arrivals in by_kind.items()
        },
        lost=sum(experiment.lost(arrivals, window) for arrivals in by_kind.values()),
        own_ms=at_or_none((hop.delay_ms for hop in only(Hop, hops)), 0.5) if hops else own_ms,
        machine_percent=processor.machine_percent(*readings),
        own_percent=processor.own_percent(*readings),
        agent_percent=agent_percent,
    )


RUNS: Final[dict[str, tuple[ExperimentScenario, Callable[[Order], list[Travelled]]]]] = {
    "one-host": (ONE_HOST, _one_host),
    "bridge": (BRIDGE, _bridge),
    "two-hosts": (TWO_HOSTS, _two_hosts),
    "zenoh": (ZENOH, _zenoh),
    "router": (ROUTER, _router),
    "topics": (TOPICS, _topics),
}
CASES: Final = tuple(RUNS)
