"""Ten topics at 10 Hz there and back, through each transport, and by DDS alone beside it in the same run.

The far end sends every message back as it came, so no two clocks are compared: half of a round trip, less the delay
that the wire is told to make, is what the way through us adds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload_lab.bench import kinds
from robot_offload_lab.bench.analysis import experiment
from robot_offload_lab.bench.kinds import KINDS, RATE_HZ
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.judge.measures import Interval, Measures
from robot_offload_lab.judge.streams import quantile
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from tests.e2e.bench.direct import Direct
from tests.e2e.bench.place import Place
from tests.e2e.figures import figure, tell
from tests.e2e.images import APP
from tests.e2e.robot import Robot
from tests.e2e.story import READY, Manifest, Story
from tests.e2e.transports_parts import carry
from tests.e2e.waiting import NotSeenError

GROUP: Final = "latency"
DELAYS_MS: Final = (0.0, 10.0)
TRANSPORTS: Final = ("Zenoh", "DiscoveryServer", "StaticPeers")
DEFAULT: Final = "Zenoh"
"""The only one of a quick run."""
MESSAGES: Final = 600
MESSAGES_QUICK: Final = 100
SETTLE_S: Final = 3.0
LANDING_S: Final = 1.0
NAME: Final = "bench"
SHARES: Final = {"p50": 0.5, "p99": 0.99}


@dataclass(frozen=True, slots=True)
class Added:
    """What one way adds over the wire's own delay, milliseconds; lost: of all messages."""

    p50: float | None
    p99: float | None
    count: int
    lost: int


def measure(place: Place) -> None:
    """Each delay: DDS alone first, then every transport."""
    messages = MESSAGES_QUICK if place.quick else MESSAGES
    for delay_ms in DELAYS_MS:
        with place.story("direct") as story:
            _show(f"direct DDS, wire {delay_ms:g} ms", _direct(story, delay_ms, messages))
        for transport in TRANSPORTS:
            if place.quick and transport != DEFAULT:
                continue
            label = f"{transport}, wire {delay_ms:g} ms"
            try:
                with place.story(transport.lower()) as story:
                    _show(label, _through(story, transport, delay_ms, messages))
            except (NotSeenError, ClusterError) as error:  # the others are worth having without it
                tell(f"not measured: {label}: {error}")


def _direct(story: Story, delay_ms: float, messages: int) -> Added:
    """A robot with routes to the pods, the same programs, no agents: what the field calls the baseline."""
    with Direct(story) as direct:
        direct.host.wire.set(delay_ms=delay_ms)
        direct.start()
        direct.rest(SETTLE_S)
        start_s = direct.begin()
        direct.rest(messages / RATE_HZ)
        window = Interval(start_s, steady_s())
        direct.rest(LANDING_S)
        return _added(direct.finish(), window, [Interval(start_s, float("inf"))], delay_ms)


def _through(story: Story, transport: str, delay_ms: float, messages: int) -> Added:
    """A robot with its agents; without NAT where the transport asks for a routable network."""
    routable = transport != "Zenoh"
    host = story.host(NAME, neighbour=routable)
    offload = story.apply(_resource(story, transport, delay_ms, host.address))
    story.wait_conditions(NAME, *READY)
    robot = story.robot(offload, host=host)
    robot.listen(LinkOptions(delay=f"{delay_ms:g}ms"))
    robot.start_nodes()
    robot.start_agent()
    robot.until_site("cloud", patience_s=120)
    robot.rest(SETTLE_S)
    start_s = robot.begin()
    robot.rest(messages / RATE_HZ)
    window = Interval(start_s, steady_s())
    robot.rest(LANDING_S)
    return _of_cloud(robot, window, delay_ms)


def _of_cloud(robot: Robot, window: Interval, delay_ms: float) -> Added:
    measures = robot.finish()
    in_cloud = [stay for site, stay in measures.stays if site == "cloud"]
    return _added(measures, window, in_cloud, delay_ms)


def _added(measures: Measures, window: Interval, within: Sequence[Interval], delay_ms: float) -> Added:
    by_kind = [measures.recording.outputs.get(kind.returned, ()) for kind in KINDS]
    ways = [
        latency - delay_ms
        for arrivals in by_kind
        for latency in experiment.latencies(arrivals, window, within, halved=True)
    ]
    lost = sum(experiment.lost(arrivals, window) for arrivals in by_kind)
    return Added(quantile(ways, SHARES["p50"]), quantile(ways, SHARES["p99"]), len(ways), lost)


def _show(label: str, added: Added) -> None:
    figure(f"{label}: added one way p50", added.p50, "ms")
    figure(f"{label}: added one way p99", added.p99, "ms")
    figure(f"{label}: messages there and back", added.count)
    figure(f"{label}: lost", added.lost)


def _resource(story: Story, transport: str, delay_ms: float, address: str) -> Manifest:
    """The experiment's resource with this cluster's image, and the addresses of a routable robot."""
    offload: RobotOffload = kinds.offload(transport, 2 * delay_ms)
    manifest: Manifest = offload.model_dump(by_alias=True, exclude_defaults=True, mode="json")
    manifest |= {"apiVersion": "robotoffload.dev/v1alpha1", "kind": "RobotOffload", "metadata": {"name": NAME}}
    for node in manifest["spec"]["nodes"]:
        if node["placement"] == "Duplicated":
            node["image"] = story.images.references[APP]
    return manifest if transport == DEFAULT else carry(manifest, transport, address)
