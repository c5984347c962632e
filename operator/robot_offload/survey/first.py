"""A first RobotOffload from five answers: one node on both sides, its outputs and inputs, and what stops the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.errors import InputError
from robot_offload.survey.sketch import Entry, NodeSketch, Sketch


@dataclass(frozen=True, slots=True)
class Answers:
    """A person's answers about the robot.

    Attributes:
        name: the robot's name.
        node: the node that is to run on both sides.
        publishes: each TOPIC, TOPIC:TYPE or TOPIC:TYPE:RATE.
        hears: topics.
        stop: the service that stops the robot; empty: none, and the node is not core.
        domain_id: the robot's ROS domain.
    """

    name: str
    node: str
    publishes: Sequence[str]
    hears: Sequence[str] = ()
    stop: str = ""
    domain_id: int = 0


def first(answers: Answers) -> Sketch:
    """Return the commented file of these answers.

    Raises:
        SpecError: the resource does not accept an answer; every problem at once.
        InputError: a rate is not a number.
    """
    sketch = Sketch(
        answers.name,
        head=["A first RobotOffload. Next: say how the node is started (run), then `robot-offload validate`."],
    )
    sketch.spec = {
        "robot": {"domainID": answers.domain_id},
        "transport": {"type": "Zenoh"},
        "driver": {"inhibitService": answers.stop} if answers.stop else {},
    }
    sketch.notes = {
        "robot": "ROS_DOMAIN_ID of the robot; rosDistro and rmw default to jazzy and rmw_fastrtps_cpp",
        "transport": "passes NAT with mutual TLS; docs/how-to/transports.md knows others",
        "driver": "called with data: true when a core node is not active: it must stop the robot and hold it",
    }
    sketch.to_cloud = [
        Entry({"name": topic, "maxAge": "300ms"}, "older than this in the cloud: the robot acts")
        for topic in answers.hears
    ]
    node = _node(answers)
    sketch.nodes = [node]
    rates = [float(it.value["rate"]) for it in node.lists["outputs"] if "rate" in it.value]
    if rates and min(rates) > 0:
        period = f"{max(1, min(10_000, round(1000 / min(rates))))}ms"
        sketch.spec["switching"] = {"latency": {"robotPeriod": period, "cloudPeriod": period}}
        sketch.notes["switching"] = (
            "the cloud acts while loop latency + cloudPeriod <= robotPeriod + tolerance (30ms by default): lower "
            "cloudPeriod when the replica there is faster, raise tolerance by what the robot's speed allows"
        )
    parse_object(sketch.values(), "init")
    return sketch


def _node(answers: Answers) -> NodeSketch:
    node = NodeSketch(answers.node, "Duplicated")
    node.notes.append(
        "on the robot and, as a replica, in the cloud; one side acts. It must be a lifecycle node, or write"
    )
    node.notes.append("lifecycle: false for one that may run on both sides all the time")
    if answers.stop:
        node.fields["core"] = True
        node.notes.append("core: without it the robot must not move")
    node.notes.append("a cluster needs an image (robot-offload dockerfile writes one), and the node's run:")
    node.notes.append("  image: registry.example/controller:1")
    node.notes.append("  run: {package: my_package, executable: my_executable}")
    for text in answers.publishes:
        node.lists["outputs"].append(_output(text))
    return node


def _output(text: str) -> Entry:
    topic, _, rest = text.partition(":")
    kind, _, rate = rest.partition(":")
    value: dict[str, object] = {"topic": topic}
    if kind:
        value["type"] = kind
    if rate:
        try:
            number = float(rate)
            value["rate"] = int(number) if number.is_integer() else number
        except ValueError:
            raise InputError(
                f"{text}: {rate!r} is not a valid rate; write messages per second, e.g. /cmd_vel:{kind}:20"
            ) from None
    note = (
        "with a rate its silence counts as failure; while: for outputs that pause"
        if rate
        else "add rate to judge silence"
    )
    return Entry(value, note)
