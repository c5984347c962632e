"""Parameters of outputs and inputs, and the core's view of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from robot_offload_agent.settings.parameter import TOPIC, Parameter
from robot_offload_core.fence.token import Site
from robot_offload_core.words.declared import Frame, Priority, SettingsError, While
from robot_offload_core.words.settings import InputSpec, OutputSpec

QOS_WORDS = {
    "reliability": ("auto", "reliable", "best_effort"),
    "durability": ("auto", "volatile", "transient_local"),
}
INTERFACE = r"auto|[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*"
OPTIONAL = rf"({TOPIC})?"

SHARED_DEPTH = 100
"""Least depth of a shared output. A subscription keeps this many messages of all publishers together, and on /tf many
publish at once; the depth of tf2's listeners (`tf2_ros::TransformListener`)."""

OUTPUT: dict[str, Parameter] = {
    "topic": Parameter(None, "public topic", pattern=TOPIC),
    "type": Parameter("auto", "interface type; auto: from the graph", pattern=INTERFACE),
    "rate_hz": Parameter(0.0, "expected rate, Hz; 0: not rated", low=0, high=10000),
    "deadline_ms": Parameter(150.0, "silence of a rated output that means a fault, ms", low=0, high=60000),
    "mirror": Parameter(True, "what passes also reaches consumers in the cloud"),
    "robot_topic": Parameter(None, "private topic of the robot's replica", pattern=TOPIC),
    "cloud_topic": Parameter(None, "private topic of the cloud's replica", pattern=TOPIC),
    "node": Parameter("", "the node that publishes it"),
    "while_actions": Parameter(["none"], "the output is rated while a goal of one of these actions is executed"),
    "while_topic": Parameter(
        "", "the output is rated while messages of this topic arrive; empty: always", pattern=OPTIONAL
    ),
    "while_within_ms": Parameter(0.0, "how long one such message counts, ms", low=0, high=60000),
    "shared": Parameter(False, "other publishers on the public topic are no fault"),
    "frames": Parameter(["none"], "transforms of the group, `PARENT CHILD`"),
    "of_cloud": Parameter(False, "its node runs in the cloud only"),
    "max_age_ms": Parameter(0.0, "oldest message that passes, ms; 0: max_command_age_ms", low=0, high=600000),
    "hot": Parameter(["none"], "sides on which its node stays Active in standby: robot, cloud"),
    "waits": Parameter(False, "its node calls names outside, so that its first message comes after a switch"),
    "reliability": Parameter("auto", "QoS", choices=QOS_WORDS["reliability"]),
    "durability": Parameter("auto", "QoS", choices=QOS_WORDS["durability"]),
    "depth": Parameter(10, "QoS history depth", low=1, high=10000),
}
INPUT: dict[str, Parameter] = {
    "topic": Parameter(None, "topic of the robot", pattern=TOPIC),
    "type": Parameter("auto", "interface type; auto: from the graph", pattern=INTERFACE),
    "max_age_ms": Parameter(0.0, "oldest message that reaches the cloud's nodes, ms; 0: no limit", low=0, high=600000),
    "max_rate_hz": Parameter(0.0, "messages above this rate are left out, Hz; 0: no limit", low=0, high=10000),
    "min_rate_hz": Parameter(0.0, "the topic is thinned to this rate at most, Hz; 0: never", low=0, high=10000),
    "priority": Parameter("Normal", "what goes first on a narrow link", choices=tuple(p.value for p in Priority)),
    "latest": Parameter(False, "a newer message replaces one that waits to be sent"),
    "latched": Parameter(False, "keep the last message and give it to every new session"),
    "reliability": Parameter("auto", "QoS", choices=QOS_WORDS["reliability"]),
    "durability": Parameter("auto", "QoS", choices=QOS_WORDS["durability"]),
    "depth": Parameter(10, "QoS history depth", low=1, high=10000),
}


def output_spec(name: str, values: Mapping[str, Any]) -> OutputSpec:
    """Return the collector's specification of an output: `name` is its identifier, `values` its parameters."""
    rate_hz = values["rate_hz"]
    return OutputSpec(
        name,
        values["deadline_ms"] / 1e3 if rate_hz else 0.0,
        1 / rate_hz if rate_hz else 0.0,
        _condition(values),
        values["shared"],
        tuple(Frame(*text.partition(" ")[::2]) for text in _given(values["frames"])),
        values["of_cloud"],
        values["max_age_ms"] / 1e3,
        (values["node"],) if values["node"] else (),
        tuple(site for site in Site if site.value in values["hot"]),
        values["waits"],
        values["topic"],
        values["durability"] == "transient_local",
    )


def completed(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a node, output or input, with the values that follow from them."""
    shared = values.get("shared", False)
    return {**values, "depth": max(values["depth"], SHARED_DEPTH)} if shared else dict(values)


def output_problems(name: str, values: Mapping[str, Any]) -> Iterator[str]:
    """Yield the problems of an output, with the parameter's name."""
    spec = output_spec(name, values)
    if problem := spec.problem():
        yield f"parameter output.{name}.deadline_ms: {problem}"
        return
    try:
        spec.check()
    except SettingsError as error:
        yield f"parameter output.{name}.{error}"


def input_spec(values: Mapping[str, Any]) -> InputSpec:
    """Return the core's specification of an input, which it names to people by its topic."""
    return InputSpec(
        values["topic"],
        values["max_age_ms"] / 1e3,
        values["max_rate_hz"],
        values["min_rate_hz"],
        Priority(values["priority"]),
        values["latest"],
    )


def is_silent(topic: str, silent: Sequence[str], namespace: str) -> bool:
    """Return whether a full name is one of `silent`: a name, `NAME/*` (one level below) or `NAME/**` (all below)."""
    base = namespace.rstrip("/")
    for pattern in silent:
        full = pattern if pattern.startswith("/") else f"{base}/{pattern}"
        name, _, ending = full.rpartition("/")
        if ending == "**" and (topic.startswith(f"{name}/") or topic == name):
            return True
        if topic == full or (ending == "*" and topic.rpartition("/")[0] == name):
            return True
    return False


def _condition(values: Mapping[str, Any]) -> While | None:
    actions = _given(values["while_actions"])
    if not actions and not values["while_topic"]:
        return None
    return While(tuple(actions), values["while_topic"], values["while_within_ms"] / 1e3)


def _given(words: list[str]) -> list[str]:
    return [word for word in words if word != "none"]
