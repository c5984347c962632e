"""One-way latencies through the product, beside direct DDS and beside datagrams of our own through the same wire."""

from __future__ import annotations

from typing import Final

from robot_offload_lab.bench.analysis import latency
from robot_offload_lab.bench.analysis.latency import LatencyAccount
from robot_offload_lab.bench.observed import Hop, only
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.resource import COMMAND, BenchCase, Sensor
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import DIRECT_TOPIC, MeasuredSystem
from robot_offload_lab.wire.options import LinkOptions

SIZES: Final = (64, 1024, 16384)
CASE: Final = BenchCase(
    "latency",
    LinkOptions(delay="10ms"),
    tolerance_ms=30,
    command_bytes=SIZES,
    sensors=(Sensor("input", SIZES),),
)
STEP_S: Final = 1.0


def steps(amounts: Amounts) -> float:
    """For the progress bar."""
    return amounts.latency_s / STEP_S


def run(order: Order) -> GroupResult:
    """Lets messages of all sizes travel."""
    with MeasuredSystem(CASE, order.timing(CASE.name)) as world:
        for _ in range(round(order.amounts.latency_s / STEP_S)):
            world.rest(STEP_S)
            order.advance(1)
        evidence = world.finish()
    assert evidence.inputs is not None
    account = LatencyAccount(
        commands=evidence.recording.outputs.get(COMMAND, ()),
        inputs=evidence.inputs.outputs.get(CASE.sensors[0].topic, ()),
        direct=evidence.recording.outputs.get(DIRECT_TOPIC, ()),
        hops=only(Hop, evidence.hops),
    )
    return latency.outcome(CASE, order.priority, account)
