"""Rules about the nodes and the topics between the sides."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.api.v1alpha1.names import identifier
from robot_offload.api.v1alpha1.nodes import Node, Run, flat_parameters
from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.findings import repeated
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.findings import Finding


def milliseconds(duration: str) -> str:
    """Return CEL for a duration in milliseconds, whether getMilliseconds() is the total or the part below 1 s."""
    return f"(duration({duration}).getSeconds() * 1000 + duration({duration}).getMilliseconds() % 1000)"


def _moved(node: Node) -> list[str]:
    """Return the collected outputs of a node that its own remappings would move."""
    remap = node.run.remap if node.run is not None else {}
    return [it.topic for it in node.outputs if node.in_cloud and remap.get(it.topic, it.topic) != it.topic]


RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "spec.topics.toCloud[]",
        "Contradiction",
        "!self.latched || !has(self.qos) || !has(self.qos.durability) || self.qos.durability != 'Volatile'",
        lambda topic: topic.latched and topic.qos is not None and topic.qos.durability == "Volatile",
        "durability Volatile keeps no last value, but the topic is latched; write TransientLocal or latched: false",
        "qos.durability",
    ),
    Rule(
        "spec.nodes[].run",
        "TwoPrograms",
        "!has(self.command) || size(self.command) == 0 || (!has(self.package) && !has(self.executable))",
        lambda run: bool(run.command) and any((run.package, run.executable)),
        "has both command and package or executable; keep one of the two",
    ),
    Rule(
        "spec.nodes[].run",
        "NoProgram",
        "(has(self.command) && size(self.command) > 0) || (has(self.package) && has(self.executable))",
        lambda run: not run.command and not all((run.package, run.executable)),
        "needs either command, or package together with executable",
    ),
    Rule(
        "spec.nodes[]",
        "RemapsOutput",
        "self.placement == 'Robot' || !has(self.outputs) || !has(self.run) || !has(self.run.remap) || "
        "self.outputs.all(o, !(o.topic in self.run.remap) || self.run.remap[o.topic] == o.topic)",
        lambda node: bool(_moved(node)),
        "run.remap moves an output; declare the output under the name that consumers know",
        "run.remap",
        lambda node: ", ".join(_moved(node)),
    ),
    Rule(
        "spec.nodes[]",
        "CoreInCloud",
        "!self.core || self.placement != 'Cloud'",
        lambda node: node.core and node.placement == "Cloud",
        "a core node with placement Cloud would hold the robot at every loss of the link; write Duplicated (with "
        "another model on the robot, say), or remove core and let the robot's program look at /offload/available",
        "core",
        lambda node: f"node {node.name!r}",
    ),
    Rule(
        "spec.nodes[].outputs[]",
        "NoRate",
        "!has(self.deadline) || has(self.rate)",
        lambda output: output.deadline_ms is not None and output.rate_hz is None,
        "an output without a rate is not judged; add its rate or remove deadline",
        "deadline",
    ),
    Rule(
        "spec.nodes[].outputs[]",
        "TooShort",
        f"!has(self.deadline) || !has(self.rate) || double({milliseconds('self.deadline')}) * self.rate > 1000.0",
        lambda output: bool(output.deadline_ms and output.rate_hz) and output.deadline_ms <= 1000.0 / output.rate_hz,
        "deadline is not more than one period of the rate, so a healthy output would fail; write at least two periods",
        "deadline",
        lambda output: f"at least {text(int(2000.0 / output.rate_hz) + 1)}",
    ),
)


def names_are_unique(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """No two nodes of one name, no topic listed twice, no output with two publishers."""
    nodes = [(f"spec.nodes[{i}].name", node.name) for i, node in enumerate(spec.nodes)]
    topics = [(f"spec.topics.toCloud[{i}].name", topic.name) for i, topic in enumerate(spec.topics.to_cloud)]
    outputs = [
        (f"spec.nodes[{i}].outputs[{j}].topic", output.topic)
        for i, node in enumerate(spec.nodes)
        for j, output in enumerate(node.outputs)
    ]
    yield from repeated(nodes, "DuplicateNode", "is the name of two nodes; rename one")
    yield from repeated(topics, "DuplicateTopic", "is listed twice; remove one of the two")
    yield from repeated(
        outputs,
        "DuplicateOutput",
        "is an output of two nodes, so it is not known whose messages pass; give one another topic",
    )


def crossing_topics_are_distinct(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A collected output crosses by itself; no two crossing topics may get one identifier."""
    outputs = {output.topic for _, output in spec.collected_outputs}
    crossing = [
        (f"spec.nodes[{i}].outputs[{j}].topic", output.topic)
        for i, node in enumerate(spec.nodes)
        if node.in_cloud
        for j, output in enumerate(node.outputs)
    ]
    for i, topic in enumerate(spec.topics.to_cloud):
        path = f"spec.topics.toCloud[{i}].name"
        if topic.name in outputs:
            yield Finding(
                path,
                "AlsoAnOutput",
                f"{topic.name!r} is an output of a node in the cloud and crosses by itself; remove it here (its "
                "`mirror` decides whether the cloud hears it)",
            )
        crossing.append((path, topic.name))
    identifiers: dict[str, str] = {}
    for path, name in crossing:
        other = identifiers.setdefault(identifier(name), name)
        if other != name:
            yield Finding(path, "AmbiguousTopic", f"{name!r} and {other!r} differ only in underscores; rename one")


def nodes_do_what_they_say(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """What is allowed and most likely not meant."""
    for i, node in enumerate(spec.nodes):
        path = f"spec.nodes[{i}]"
        if node.duplicated and node.core and not node.outputs and not node.offered:
            yield Finding(
                f"{path}.outputs",
                "NothingCollected",
                f"core node {node.name!r} is Duplicated but declares neither outputs nor services nor actions, so "
                "both replicas could be heard; list what others get from it",
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


def _plain_outputs(path: str, node: Node) -> Iterator[Finding]:
    """Outputs of nodes that only the robot has are not collected: they are plain topics there."""
    if node.in_cloud:
        return
    for j, output in enumerate(node.outputs):
        yield Finding(
            f"{path}.outputs[{j}]",
            "NotCollected",
            f"{output.topic!r} of a node with placement Robot is a plain topic of its side; list it under "
            "spec.topics.toCloud if the cloud needs it",
            "warning",
        )


def core_nodes_can_stop_the_robot(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Without the service a missing core node is only noticed by the driver itself."""
    if any(node.core for node in spec.nodes) and spec.driver.inhibit_service is None:
        yield Finding(
            "spec.driver.inhibitService",
            "NoInhibitService",
            "there are core nodes but no service that stops the robot without them; only the driver's own "
            "command time-out will",
            "warning",
        )


def shared_topics_are_carried(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The agents fill the private names of shared topics with what they carry; on DDS transports they carry none."""
    if spec.transport.type == "Zenoh":
        return
    for i, node in enumerate(spec.nodes):
        for j, output in enumerate(node.outputs):
            if output.shared or output.frames:
                yield Finding(
                    f"spec.nodes[{i}].outputs[{j}].shared",
                    "SharedNeedsZenoh",
                    f"{output.topic} has publishers outside the group, and only transport Zenoh keeps both apart; "
                    "change spec.transport.type to Zenoh, or let a node on the robot publish the topic",
                )


def doubles_survive_kubernetes(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """JSON knows one kind of number: 20.0 comes back as 20, and ROS 2 refuses that for a double."""
    for i, node in enumerate(spec.nodes):
        if node.run is not None:
            yield from _doubles(f"spec.nodes[{i}].run", node.run)


def _doubles(path: str, run: Run) -> Iterator[Finding]:
    fields = (("parameters", run.parameters), ("cloudParameters", run.cloud_parameters))
    values = [(field, name, value) for field, mapping in fields for name, value in flat_parameters(mapping)]
    for field, name, value in values:
        numbers = value if isinstance(value, tuple | list) else (value,)
        whole = any(isinstance(number, float) and number.is_integer() for number in numbers)
        if whole and name not in run.doubles:
            yield Finding(
                f"{path}.{field}.{name}",
                "WholeDouble",
                f"Kubernetes keeps a whole number without its point, which ROS 2 refuses for a double; add {name} to "
                "run.doubles",
                "warning",
            )
    known = {name for _, name, _ in values}
    for i, name in enumerate(run.doubles):
        if name not in known:
            yield Finding(
                f"{path}.doubles[{i}]", "NoParameter", f"{name!r} is not a parameter here; correct it", "warning"
            )


def parameters_keep_their_names(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """An object that kubectl has written may hold a key that was `y` in the file: YAML 1.1 reads it as true."""
    for i, node in enumerate(spec.nodes):
        if node.run is None:
            continue
        for field, mapping in (("parameters", node.run.parameters), ("cloudParameters", node.run.cloud_parameters)):
            for name, _ in flat_parameters(mapping):
                if {"true", "false"} & set(name.split(".")):
                    yield Finding(
                        f"spec.nodes[{i}].run.{field}.{name}",
                        "MisreadName",
                        "kubectl reads the plain names y, on and yes as true, and n, off and no as false; write such a "
                        "name in quotes",
                        "warning",
                    )
