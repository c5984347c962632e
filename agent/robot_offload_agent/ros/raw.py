"""Topics as serialized bytes: types and QoS from the configuration or from the graph."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.subscription import Subscription

from robot_offload_agent.errors import StartError
from robot_offload_agent.settings.parameters import Named

INTERFACE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/msg/[A-Za-z][A-Za-z0-9_]*")
SETUP_VARIABLE = "ROBOT_OFFLOAD_SETUP"
OnRaw = Callable[[bytes], None]


def message_type(name: str) -> Any:
    """Returns the class of an interface type such as `sensor_msgs/msg/LaserScan`.

    Raises:
        StartError: it cannot be imported; names the package.
    """
    package, _, short = name.partition("/msg/")
    if not INTERFACE.fullmatch(name):  # anybody in the graph can give a topic any type
        raise StartError(f"{name!r:.100} is no interface type")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError) as error:
        raise StartError(
            f"Interface type {name} cannot be imported here: no installed package {package} has it; run the agent "
            f"inside the overlay that has it ({SETUP_VARIABLE} in the bundle's `environment`), or build it into the "
            "agent's image"
        ) from error


def graph_type(node: Node, topic: str) -> str:
    """Returns the type that publishers of a topic use now; "" when there is none or they disagree."""
    types = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
    return types.pop() if len(types) == 1 else ""


def subscription_qos(node: Node, topic: str, spec: Named, latched: bool) -> QoSProfile | None:
    """QoS that hears every publisher there is now; None while there is none and something must be read from them."""
    infos = node.get_publishers_info_by_topic(topic)
    if not infos and "auto" in (spec["reliability"], spec["durability"]):
        return None
    reliable = all(i.qos_profile.reliability is ReliabilityPolicy.RELIABLE for i in infos)
    kept = all(i.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for i in infos) if infos else latched
    return profile(spec, reliable, kept)


def publication_qos(spec: Named, latched: bool) -> QoSProfile:
    """QoS for what we publish: reliable, so that every kind of subscriber can match."""
    return profile(spec, reliable=True, kept=latched)


def profile(spec: Named, reliable: bool, kept: bool) -> QoSProfile:
    """Returns the declared words, `auto` filled in from the two flags."""
    if spec["reliability"] != "auto":
        reliable = spec["reliability"] == "reliable"
    if spec["durability"] != "auto":
        kept = spec["durability"] == "transient_local"
    return QoSProfile(
        depth=spec["depth"],
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
    )


@dataclass
class RawSubscription:
    """A subscription that waits for type and QoS to be known, then delivers bytes.

    Attributes:
        topic: what is subscribed.
        spec: the output or input that it belongs to.
        type_name: declared, or found in the graph.
        problem: (reason, message) for diagnostics while something is wrong.
    """

    node: Node
    topic: str
    spec: Named
    latched: bool
    on_raw: OnRaw
    type_name: str = ""
    qos: QoSProfile | None = None
    subscription: Subscription | None = None
    problem: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        self.type_name = "" if self.spec["type"] == "auto" else self.spec["type"]
        if self.type_name:
            message_type(self.type_name)  # a declared type that is missing stops the start

    def resolve(self) -> bool:
        """Subscribes as soon as possible; call now and then, often until it returns True."""
        name = self.type_name or graph_type(self.node, self.topic)
        qos = subscription_qos(self.node, self.topic, self.spec, self.latched)
        if self.subscription is not None and (qos is None or qos == self.qos):
            self.problem = self._mismatch()
            return True
        if not name or qos is None:
            self.problem = ("NoPublisher", f"{self.topic} has no publisher yet (or several types)")
            return False
        try:
            cls = message_type(name)
        except StartError as error:
            self.problem = ("TypeMissing", str(error))
            return False
        if self.subscription is not None:  # a node that was restarted with other QoS
            self.node.destroy_subscription(self.subscription)
        self.type_name, self.qos, self.problem = name, qos, None
        self.subscription = self.node.create_subscription(cls, self.topic, self.on_raw, qos, raw=True)
        return True

    def _mismatch(self) -> tuple[str, str] | None:
        """Publishers that cannot be heard with what was declared."""
        deaf_to = sorted(
            info.node_name for info in self.node.get_publishers_info_by_topic(self.topic)
            if qos_check_compatible(info.qos_profile, self.qos)[0] is QoSCompatibility.ERROR
        )  # fmt: skip
        if not deaf_to:
            return None
        declared = f"reliability {self.spec['reliability']}, durability {self.spec['durability']}"
        return "QosMismatch", f"{self.topic} of {', '.join(deaf_to)} cannot be heard with the declared QoS ({declared})"


def make_publisher(node: Node, topic: str, type_name: str, qos: QoSProfile) -> Publisher:
    """Returns a publisher for serialized bytes; raises StartError when the type is missing."""
    return node.create_publisher(message_type(type_name), topic, qos)
