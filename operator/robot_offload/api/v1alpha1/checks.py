"""Rules between fields, in one list. Each check is a pure function (spec) -> findings.

A check gets a specification whose single fields are right already. Findings of severity `error` refuse it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final, TypeAlias

from robot_offload.api.v1alpha1.model import yaml_name
from robot_offload.api.v1alpha1.names import identifier
from robot_offload.api.v1alpha1.nodes import RESERVED_VARIABLES, Node
from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import FAST_DDS, RobotOffloadSpec
from robot_offload.api.v1alpha1.transport import BLOCKS
from robot_offload.findings import Finding, Severity

Check: TypeAlias = Callable[[RobotOffloadSpec], Iterator[Finding]]

# Linux hands out ephemeral ports from 32768 on; a domain from 102 on (7400 + 250 * 102 = 32900) can collide with
# them, up to where they end (60999, domain 214). Source: "The ROS_DOMAIN_ID" in the ROS 2 documentation.
_EPHEMERAL_DOMAINS: Final = range(102, 215)


def check(spec: RobotOffloadSpec, rules: Sequence[Check] | None = None) -> tuple[Finding, ...]:
    """Everything that the rules between fields find, in the order of the rules.

    Args:
        spec: what is checked.
        rules: CHECKS (the default, for a run on one machine) or CLUSTER_CHECKS.
    """
    return tuple(finding for rule in (CHECKS if rules is None else rules) for finding in rule(spec))


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
    transport = spec.transport
    for block, types in BLOCKS.items():
        if block in transport.model_fields_set and transport.type not in types:
            yield Finding(
                f"spec.transport.{yaml_name(block)}",
                "WrongBlock",
                f"does not belong to transport type {transport.type}; remove it or write type: {' or '.join(types)}",
            )
    if transport.type == "StaticPeers" and not transport.static_peers.robot:
        yield Finding(
            "spec.transport.staticPeers.robot",
            "NoPeers",
            "transport type StaticPeers needs at least one address of the robot, as the cloud reaches it",
        )


def _exposure_is_consistent(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """What only one type of Service has, and ports that two listeners would share."""
    transport = spec.transport
    expose, path = transport.expose, "spec.transport.expose"
    for field in ("address", "load_balancer_class"):
        if getattr(expose, field) is not None and expose.type != "LoadBalancer":
            yield Finding(
                f"{path}.{yaml_name(field)}",
                "WrongExposure",
                f"belongs to type LoadBalancer, but the type is {expose.type}; remove it or write type: LoadBalancer",
            )
    if expose.node_ports is not None and expose.type == "ClusterIP":
        yield Finding(
            f"{path}.nodePorts",
            "WrongExposure",
            "Services of type ClusterIP have no ports on the nodes; remove it or write type: NodePort",
        )
    if transport.zenoh.pulse_port == transport.zenoh.data_port:
        yield Finding(
            "spec.transport.zenoh.dataPort",
            "SamePort",
            f"{transport.zenoh.data_port} is the port of the pulse as well; give the data session another one",
        )
    if expose.node_ports is not None:
        given = [port for port in expose.node_ports.model_dump().values() if port is not None]
        if len(set(given)) < len(given):
            yield Finding(
                f"{path}.nodePorts", "SamePort", "gives one port twice; a port of the nodes serves one purpose only"
            )


def _certificates_are_renewed_in_time(spec: RobotOffloadSpec) -> Iterator[Finding]:
    certificates = spec.transport.certificates
    if certificates.renew_before_ms >= certificates.duration_ms:
        yield Finding(
            "spec.transport.certificates.renewBefore",
            "TooLong",
            f"{text(certificates.renew_before_ms)} is not less than duration {text(certificates.duration_ms)}, so "
            "certificates would be renewed all the time; write for example a third of duration",
        )


def _environment_is_free(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """No variable is set twice, and none of those by which nodes find each other."""
    for i, node in enumerate(spec.nodes):
        names = [(f"spec.nodes[{i}].env[{j}].name", variable.name) for j, variable in enumerate(node.env)]
        yield from _repeated(names, "DuplicateVariable", "is set twice; remove one of the two")
        for path, name in names:
            if name in RESERVED_VARIABLES:
                yield Finding(
                    path, "ReservedVariable", f"{name!r} follows from the resource and cannot be set; remove it"
                )


def _tolerations_are_complete(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The rules that Kubernetes has for tolerations, told before a pod is refused."""
    for i, toleration in enumerate(spec.cloud.tolerations):
        path = f"spec.cloud.tolerations[{i}]"
        if toleration.operator == "Exists" and toleration.value:
            yield Finding(f"{path}.value", "Contradiction", "operator Exists takes no value; remove it")
        if toleration.key is None and toleration.operator == "Equal":
            yield Finding(f"{path}.key", "Required", "is missing; give a key or write operator: Exists")
        if toleration.toleration_seconds is not None and toleration.effect != "NoExecute":
            yield Finding(
                f"{path}.tolerationSeconds", "Contradiction", "counts for effect NoExecute only; remove it or add that"
            )


def _pull_secrets_are_unique(spec: RobotOffloadSpec) -> Iterator[Finding]:
    names = [(f"spec.cloud.imagePullSecrets[{i}].name", it.name) for i, it in enumerate(spec.cloud.image_pull_secrets)]
    yield from _repeated(names, "DuplicateSecret", "is listed twice; remove one of the two")


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


def _images(severity: Severity) -> Check:
    def cloud_nodes_have_images(spec: RobotOffloadSpec) -> Iterator[Finding]:
        for i, node in enumerate(spec.nodes):
            if node.in_cloud and node.image is None:
                yield Finding(
                    f"spec.nodes[{i}].image",
                    "NoImage",
                    f"node {node.name!r} has placement {node.placement}, so a cluster needs the image of its replica "
                    "in the cloud; add image",
                    severity,
                )

    return cloud_nodes_have_images


def _cloud_nodes_say_how_they_start(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Without a command line nobody could give the replica its name, its parameters and its private topics."""
    for i, node in enumerate(spec.nodes):
        if node.in_cloud and node.run is None:
            yield Finding(
                f"spec.nodes[{i}].run",
                "NoProgram",
                f"node {node.name!r} has placement {node.placement}, so a cluster must know how to start it; add run",
            )


def _cloud_rmw_knows_discovery_servers(spec: RobotOffloadSpec) -> Iterator[Finding]:
    if spec.cloud_rmw not in FAST_DDS:
        yield Finding(
            "spec.cloud.rmw",
            "CloudRmw",
            f"{spec.cloud_rmw} cannot find nodes through discovery servers, as a cluster needs it; write "
            f"rmw: {FAST_DDS[0]} under spec.cloud",
        )


_EVERYWHERE: Final[tuple[Check, ...]] = (
    _transport_block_fits_type,
    _exposure_is_consistent,
    _certificates_are_renewed_in_time,
    _domains_avoid_ephemeral_ports,
    _pull_secrets_are_unique,
    _tolerations_are_complete,
    _names_are_unique,
    _crossing_topics_are_distinct,
    _latched_topics_are_transient_local,
    _nodes_are_complete,
    _environment_is_free,
    _runs_name_one_program,
    _core_nodes_can_stop_the_robot,
    _loss_timeout_fits_heartbeat,
    _loop_latency_is_possible,
    _lease_outlives_detection,
    _command_age_covers_loop,
    _hold_down_grows,
)
CHECKS: Final[tuple[Check, ...]] = (*_EVERYWHERE, _images("warning"))
"""The rules for a run on one machine, where processes need no images."""
CLUSTER_CHECKS: Final[tuple[Check, ...]] = (
    *_EVERYWHERE,
    _images("error"),
    _cloud_nodes_say_how_they_start,
    _cloud_rmw_knows_discovery_servers,
)
"""The rules of a cluster: what the operator and `validate --cluster` ask for."""
