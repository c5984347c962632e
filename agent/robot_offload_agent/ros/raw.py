"""Topics as serialized bytes: types and QoS from the configuration or from the graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from robot_offload_agent.errors import StartError
from robot_offload_agent.ros.interfaces import message_type
from robot_offload_agent.ros.topic_loop import WithInfo
from robot_offload_agent.settings.parameters import Named
from robot_offload_core.collector.rivals import Endpoint
from robot_offload_core.words import topic_kinds

OnRaw = Callable[[bytes], None]
OnStamped = Callable[[bytes, float | None], None]
"""With the publisher's stamp, by the system clock of its host, seconds; None if the middleware has none."""
_INFINITE_NS = 2**62
NAMELESS = "_NODE_NAME_UNKNOWN_"
"""The name that rmw gives to the node of an endpoint until its name is announced."""


def graph_type(node: Node, topic: str) -> str:
    """Return the type that publishers of a topic use now; "" if there are none or they disagree."""
    types = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
    return types.pop() if len(types) == 1 else ""


def subscription_qos(node: Node, topic: str, spec: Named, latched: bool) -> QoSProfile | None:
    """Return QoS that matches every publisher there is now; None if one must be read and there is none."""
    infos = node.get_publishers_info_by_topic(topic)
    if not infos and "auto" in (spec["reliability"], spec["durability"]):
        return None
    reliable = all(i.qos_profile.reliability is ReliabilityPolicy.RELIABLE for i in infos)
    kept = all(i.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for i in infos) if infos else latched
    return profile(spec, reliable, kept)


def offered_qos(node: Node, output: Named, private: str) -> QoSProfile | None:
    """Return the QoS that an output's public topic offers: that of the replica's own publisher; None without one.

    It is reliable, so that every subscriber matches, unless the output declares otherwise. A deadline or liveliness
    that the replica promises is promised to the consumers as well: subscribers that ask for one match no other
    publisher. Messages to which the replica gives a lifespan get it here too.

    Args:
        node: of the agent, whose graph is read.
        output: its parameters.
        private: topic of the replica.
    """
    infos = node.get_publishers_info_by_topic(private)
    if not infos:
        return None
    replica = infos[0].qos_profile
    offered = publication_qos(output, all(i.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for i in infos))
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        duration = getattr(replica, name)
        if 0 < duration.nanoseconds < _INFINITE_NS:
            setattr(offered, name, duration)
    if replica.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC:
        offered.liveliness = replica.liveliness  # each message that passes asserts it
    return offered


def unheard(node: Node, topic: str) -> tuple[str, str] | None:
    """Return the problem that subscribers request more than `node` offers on a topic; None if all match."""
    # Taken from the graph, too: there an absent duration is infinite, in a profile made here it is 0.
    ours = [i.qos_profile for i in node.get_publishers_info_by_topic(topic) if i.node_name == node.get_name()]
    deaf = sorted(
        f"{info.node_name} ({reason.strip()})" for info in node.get_subscriptions_info_by_topic(topic)
        for verdict, reason in [qos_check_compatible(offered, info.qos_profile) for offered in ours[:1]]
        if verdict == QoSCompatibility.ERROR
    )  # fmt: skip
    return ("IncompatibleQos", f"{topic} cannot be heard by {', '.join(deaf)}") if deaf else None


def endpoint(info: TopicEndpointInfo) -> Endpoint:
    """Return a publisher of the graph as the core judges it."""
    known = info.node_name not in ("", NAMELESS)
    node = f"{info.node_namespace.rstrip('/')}/{info.node_name}" if known else ""
    return Endpoint(bytes(info.endpoint_gid), node)


def named_type(name: str, type_hash: str) -> str:
    """Return a type as the two sides compare it: its name, then a blank and its hash if there is one."""
    return f"{name} {type_hash}" if type_hash else name


def graph_type_hash(node: Node, topic: str) -> str:
    """Return the hash of the type that all publishers of a topic use; "" if rmw gives none (before Iron)."""
    hashes = {str(getattr(info, "topic_type_hash", "") or "") for info in node.get_publishers_info_by_topic(topic)}
    return hashes.pop() if len(hashes) == 1 else ""


def own_type_hash(node: Node, topic: str) -> str:
    """Return the hash of the type of this agent's own publisher of a topic; "" if rmw gives none."""
    mine = [i for i in node.get_publishers_info_by_topic(topic) if i.node_name == node.get_name()]
    hashes = {str(getattr(info, "topic_type_hash", "") or "") for info in mine}
    return hashes.pop() if len(hashes) == 1 else ""


def publication_qos(spec: Named, latched: bool) -> QoSProfile:
    """Return QoS for what the agent publishes: reliable, so that every kind of subscriber can match."""
    return profile(spec, reliable=True, kept=latched)


def profile(spec: Named, reliable: bool, kept: bool) -> QoSProfile:
    """Return the declared QoS, with `auto` filled in from the two flags."""
    if spec["reliability"] != "auto":
        reliable = spec["reliability"] == "reliable"
    if spec["durability"] != "auto":
        kept = spec["durability"] == "transient_local"
    return QoSProfile(
        depth=spec["depth"],
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
    )


def stamped(hear: OnStamped) -> WithInfo:
    """Return a callback that passes on the publisher's stamp with each message."""

    def heard(payload: bytes, info: Mapping[str, int]) -> None:
        stamp_ns = info["source_timestamp"]
        hear(payload, stamp_ns / 1e9 if stamp_ns > 0 else None)

    return WithInfo(heard)


@dataclass
class RawSubscription:
    """A subscription that waits for type and QoS to be known, then delivers bytes.

    Attributes:
        topic: the subscribed topic.
        spec: the output or input that it belongs to.
        type_name: declared, or found in the graph.
        type_hash: of the publishers' type, "" while it is not known.
        problem: (reason, message) for diagnostics while something is wrong.
    """

    node: Node
    topic: str
    spec: Named
    latched: bool
    on_raw: OnRaw | WithInfo
    type_name: str = ""
    type_hash: str = ""
    qos: QoSProfile | None = None
    subscription: Subscription | None = None
    problem: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        self.type_name = "" if self.spec["type"] == "auto" else self.spec["type"]
        if self.type_name:
            message_type(self.type_name)  # a declared type that is missing stops the start

    def resolve(self) -> bool:
        """Subscribe as soon as possible; call this repeatedly, often until it returns True."""
        name = self.type_name or graph_type(self.node, self.topic)
        qos = subscription_qos(self.node, self.topic, self.spec, self.latched)
        publishers = self.node.get_publishers_info_by_topic(self.topic)
        found = [(endpoint(info).node, info.topic_type) for info in publishers]
        otherwise = topic_kinds.otherwise(self.topic, self.spec["type"], found)
        if self.subscription is not None and (qos is None or qos == self.qos):
            self.problem = otherwise or self._mismatch()
            return True
        if not name or qos is None:
            self.problem = otherwise or ("NoPublisher", f"{self.topic} has no publisher yet (or several types)")
            return False
        try:
            cls = message_type(name)
        except StartError as error:
            self.problem = ("TypeMissing", str(error))
            return False
        if self.subscription is not None:  # a node that was restarted with other QoS
            self.node.destroy_subscription(self.subscription)
        self.type_name, self.qos, self.problem = name, qos, otherwise
        self.type_hash = graph_type_hash(self.node, self.topic)
        self.subscription = self.node.create_subscription(cls, self.topic, self.on_raw, qos, raw=True)
        return True

    def _mismatch(self) -> tuple[str, str] | None:
        """Return publishers that cannot match the declared QoS."""
        deaf_to = sorted(
            info.node_name for info in self.node.get_publishers_info_by_topic(self.topic)
            if qos_check_compatible(info.qos_profile, self.qos)[0] == QoSCompatibility.ERROR
        )  # fmt: skip
        if not deaf_to:
            return None
        declared = f"reliability {self.spec['reliability']}, durability {self.spec['durability']}"
        return "QosMismatch", f"{self.topic} of {', '.join(deaf_to)} cannot be heard with the declared QoS ({declared})"


def make_publisher(node: Node, topic: str, type_name: str, qos: QoSProfile) -> Publisher:
    """Return a publisher for serialized bytes; raise StartError if the type is missing."""
    return node.create_publisher(message_type(type_name), topic, qos)
