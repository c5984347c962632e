"""Rules between fields, in one list. Each check is a pure function (spec) -> findings.

A check gets a specification whose single fields are right already. Findings of severity `error` refuse it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from robot_offload.api.v1alpha1.names import identifier
from robot_offload.api.v1alpha1.nodes import Node
from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.findings import Finding

Check: TypeAlias = Callable[[RobotOffloadSpec], Iterator[Finding]]

# Linux hands out ephemeral ports from 32768 on; a domain from 102 on (7400 + 250 * 102 = 32900) can collide with
# them, up to where they end (60999, domain 214). Source: "The ROS_DOMAIN_ID" in the ROS 2 documentation.
_EPHEMERAL_DOMAINS: Final = range(102, 215)


def check(spec: RobotOffloadSpec) -> tuple[Finding, ...]:
    """Everything that the rules between fields find, in the order of CHECKS."""
    return tuple(finding for rule in CHECKS for finding in rule(spec))


def _loss_timeout_fits_heartbeat(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """One lost beat is normal, so more than two periods; at a multiple, beat and timer would race."""
    period, timeout = spec.switching.heartbeat_period_ms, spec.switching.loss_timeout_ms
    path = "spec.switching.lossTimeout"
    if timeout <= 2 * period:
        yield Finding(
            path,
            "TooShort",
            f"{text(timeout)} is not more than two heartbeat periods of {text(period)}, so one lost beat would be "
            f"an alarm; write for example {text(4 * period + period // 2)}",
        )
    elif timeout % period == 0:
        yield Finding(
            path,
            "MultipleOfPeriod",
            f"{text(timeout)} is a multiple of the heartbeat period {text(period)}, so the last beat and the "
            f"alarm would race; write for example {text(timeout + max(1, period // 2))}",
        )


def _loop_latency_is_possible(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The rule loop + cloudPeriod <= robotPeriod + tolerance must leave some latency to the loop."""
    latency = spec.switching.latency
    if latency.allowed_loop_ms <= 0:
        yield Finding(
            "spec.switching.latency",
            "NeverInCloud",
            f"robotPeriod {text(latency.robot_period_ms)} + tolerance {text(latency.tolerance_ms)} is not more "
            f"than cloudPeriod {text(latency.cloud_period_ms)}, so no link would ever be good enough; raise "
            "tolerance or lower cloudPeriod",
        )


def _lease_outlives_detection(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A shorter lease would end before the robot has noticed a loss: then nobody acts."""
    switching = spec.switching
    loop = max(0, switching.latency.allowed_loop_ms)
    least = switching.loss_timeout_ms + loop + 2 * switching.heartbeat_period_ms
    if switching.lease_ms < least:
        yield Finding(
            "spec.switching.lease",
            "TooShort",
            f"{text(switching.lease_ms)} is less than lossTimeout + allowed loop latency + two heartbeats "
            f"({text(switching.loss_timeout_ms)} + {text(loop)} + 2 x {text(switching.heartbeat_period_ms)}); "
            f"write at least {text(least)}",
        )


def _command_age_covers_loop(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A smaller limit would drop every message of a link that is still good enough."""
    switching = spec.switching
    loop = max(0, switching.latency.allowed_loop_ms)
    floor = loop + switching.heartbeat_period_ms
    if switching.max_command_age_ms <= floor:
        yield Finding(
            "spec.switching.maxCommandAge",
            "TooShort",
            f"{text(switching.max_command_age_ms)} is not more than the allowed loop latency {text(loop)} + one "
            f"heartbeat {text(switching.heartbeat_period_ms)}, so messages of a good link would be dropped; write "
            f"more than {text(floor)}",
        )


def _hold_down_grows(spec: RobotOffloadSpec) -> Iterator[Finding]:
    hold_down = spec.switching.hold_down
    if hold_down.initial_ms > hold_down.max_ms:
        yield Finding(
            "spec.switching.holdDown.initial",
            "OutOfRange",
            f"{text(hold_down.initial_ms)} is more than holdDown.max {text(hold_down.max_ms)}; lower it or raise max",
        )


def _transport_block_fits_type(spec: RobotOffloadSpec) -> Iterator[Finding]:
    if spec.transport.type != "Zenoh" and "zenoh" in spec.transport.model_fields_set:
        yield Finding(
            "spec.transport.zenoh",
            "WrongBlock",
            f"does not belong to transport type {spec.transport.type}; remove it or write type: Zenoh",
        )


def _domains_avoid_ephemeral_ports(spec: RobotOffloadSpec) -> Iterator[Finding]:
    for path, domain in (("robot", spec.robot.domain_id), ("cloud", spec.cloud.domain_id)):
        if domain in _EPHEMERAL_DOMAINS:
            yield Finding(
                f"spec.{path}.domainID",
                "EphemeralPorts",
                f"the ports of domain {domain} can collide with those that Linux hands out; use 0 to 101",
                "warning",
            )


def _names_are_unique(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """No two nodes of one name, no topic listed twice, no output with two publishers."""
    nodes = [(f"spec.nodes[{i}].name", node.name) for i, node in enumerate(spec.nodes)]
    topics = [(f"spec.topics.toCloud[{i}].name", topic.name) for i, topic in enumerate(spec.topics.to_cloud)]
    outputs = [
        (f"spec.nodes[{i}].outputs[{j}].topic", output.topic)
        for i, node in enumerate(spec.nodes)
        for j, output in enumerate(node.outputs)
    ]
    yield from _repeated(nodes, "DuplicateNode", "is the name of two nodes; rename one")
    yield from _repeated(topics, "DuplicateTopic", "is listed twice; remove one of the two")
    yield from _repeated(
        outputs,
        "DuplicateOutput",
        "is an output of two nodes, so nobody could tell whose messages shall pass; give one another topic",
    )


def _repeated(named: list[tuple[str, str]], reason: str, problem: str) -> Iterator[Finding]:
    first: dict[str, str] = {}
    for path, name in named:
        if name in first:
            yield Finding(path, reason, f"{name!r} {problem} (first at {first[name]})")
        first.setdefault(name, path)


def _crossing_topics_are_distinct(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A collected output crosses by itself; and no two crossing topics may get one identifier."""
    outputs = {output.topic for _, output in spec.collected_outputs}
    crossing = [
        (f"spec.nodes[{i}].outputs[{j}].topic", output.topic)
        for i, node in enumerate(spec.nodes)
        if node.duplicated
        for j, output in enumerate(node.outputs)
    ]
    for i, topic in enumerate(spec.topics.to_cloud):
        path = f"spec.topics.toCloud[{i}].name"
        if topic.name in outputs:
            yield Finding(
                path,
                "AlsoAnOutput",
                f"{topic.name!r} is an output of a duplicated node and crosses by itself; remove it here (its "
                "`mirror` decides whether the cloud hears it)",
            )
        crossing.append((path, topic.name))
    identifiers: dict[str, str] = {}
    for path, name in crossing:
        other = identifiers.setdefault(identifier(name), name)
        if other != name:
            yield Finding(path, "AmbiguousTopic", f"{name!r} and {other!r} differ only in underscores; rename one")


def _latched_topics_are_transient_local(spec: RobotOffloadSpec) -> Iterator[Finding]:
    for i, topic in enumerate(spec.topics.to_cloud):
        if topic.latched and topic.qos is not None and topic.qos.durability == "Volatile":
            yield Finding(
                f"spec.topics.toCloud[{i}].qos.durability",
                "Contradiction",
                "Volatile keeps no last value, but the topic is latched; write TransientLocal or latched: false",
            )


def _nodes_are_complete(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """What each node's placement asks for."""
    for i, node in enumerate(spec.nodes):
        path = f"spec.nodes[{i}]"
        if node.duplicated and not node.lifecycle:
            yield Finding(
                f"{path}.lifecycle",
                "NotManaged",
                f"node {node.name!r} is Duplicated, so it must be a managed (lifecycle) node: only those can be "
                "put to sleep; write lifecycle: true or another placement",
            )
        if node.duplicated and node.core and not node.outputs:
            yield Finding(
                f"{path}.outputs",
                "NothingCollected",
                f"core node {node.name!r} is Duplicated but declares no outputs, so both replicas could be "
                "heard; list the topics that it publishes",
                "warning",
            )
        if not node.duplicated and "standby" in node.model_fields_set:
            yield Finding(
                f"{path}.standby",
                "NoStandby",
                f"node {node.name!r} has placement {node.placement} and no replica in standby; remove standby",
                "warning",
            )
        yield from _plain_outputs(path, node)
        yield from _output_timing(path, node)


def _plain_outputs(path: str, node: Node) -> Iterator[Finding]:
    """Only outputs of duplicated nodes are collected; others stay plain topics of their side."""
    if node.duplicated:
        return
    advice = (
        "list it under spec.topics.toCloud if the cloud needs it"
        if node.placement == "Robot"
        else "it does not reach the robot; write placement: Duplicated if the robot needs it"
    )
    for j, output in enumerate(node.outputs):
        yield Finding(
            f"{path}.outputs[{j}]",
            "NotCollected",
            f"{output.topic!r} of a node with placement {node.placement} is a plain topic of its side; {advice}",
            "warning",
        )


def _output_timing(path: str, node: Node) -> Iterator[Finding]:
    for j, output in enumerate(node.outputs):
        where = f"{path}.outputs[{j}].deadline"
        if output.deadline_ms is None:
            continue
        if output.rate_hz is None:
            yield Finding(where, "NoRate", "an output without a rate is not judged; add its rate or remove deadline")
        elif output.deadline_ms <= 1000.0 / output.rate_hz:
            yield Finding(
                where,
                "TooShort",
                f"{text(output.deadline_ms)} is not more than one period at {output.rate_hz:g} per second, so a "
                f"healthy output would fail; write at least {text(int(2000.0 / output.rate_hz) + 1)}",
            )


def _runs_name_one_program(spec: RobotOffloadSpec) -> Iterator[Finding]:
    for i, node in enumerate(spec.nodes):
        if node.run is None:
            continue
        path, run = f"spec.nodes[{i}].run", node.run
        by_package = (run.package, run.executable)
        if run.command and any(by_package):
            yield Finding(path, "TwoPrograms", "has both command and package or executable; keep one of the two")
        elif not run.command and not all(by_package):
            yield Finding(path, "NoProgram", "needs either command, or package together with executable")
        for output in node.outputs:
            if node.duplicated and run.remap.get(output.topic, output.topic) != output.topic:
                yield Finding(
                    f"{path}.remap",
                    "RemapsOutput",
                    f"moves the output {output.topic!r} to {run.remap[output.topic]!r}; declare the output under "
                    "the name that consumers know",
                )


def _core_nodes_can_stop_the_robot(spec: RobotOffloadSpec) -> Iterator[Finding]:
    if any(node.core for node in spec.nodes) and spec.driver.inhibit_service is None:
        yield Finding(
            "spec.driver.inhibitService",
            "NoInhibitService",
            "there are core nodes but no service that stops the robot without them; only the driver's own "
            "command time-out will",
            "warning",
        )


CHECKS: Final[tuple[Check, ...]] = (
    _transport_block_fits_type,
    _domains_avoid_ephemeral_ports,
    _names_are_unique,
    _crossing_topics_are_distinct,
    _latched_topics_are_transient_local,
    _nodes_are_complete,
    _runs_name_one_program,
    _core_nodes_can_stop_the_robot,
    _loss_timeout_fits_heartbeat,
    _loop_latency_is_possible,
    _lease_outlives_detection,
    _command_age_covers_loop,
    _hold_down_grows,
)
