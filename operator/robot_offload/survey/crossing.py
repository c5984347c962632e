"""What crosses between the sides for a given set of leaving nodes: topics, services, actions, state.

A name is internal (only nodes that leave use it), served (they offer it to others), used (others offer it to them) or
mixed (both); docs/how-to/which-nodes.md explains each.
"""

from __future__ import annotations

import math
from typing import Any, Final

from robot_offload.api.v1alpha1.name_rules import OWN_TOPIC_PREFIX, own_topic
from robot_offload.survey.roles import SENSED
from robot_offload.survey.seen import World
from robot_offload.survey.sketch import Entry, NodeSketch, Sketch, plain
from robot_offload.survey.snapshot import TopicSeen

_SKIPPED: Final = ("/rosout", "/parameter_events", "/bond")
_LARGE: Final = frozenset(it for it in SENSED if it.endswith(("Image", "PointCloud2")))
_STANDARD_TYPES: Final = (
    "rcl_interfaces/",
    "lifecycle_msgs/",
    "type_description_interfaces/",
    "composition_interfaces/",
)
_CONTINUED: Final = ("NavigateToPose", "FollowPath", "ComputePathToPose", "ComputePathThroughPoses", "SmoothPath")
"""Actions of Nav2 whose goals name a target; a replica that receives one again does the same."""
_LEAST_AGE_MS: Final = 200
_PERIODS_OF_AGE: Final = 5
_JUDGED_FROM_HZ: Final = 1.0


def add_to(sketch: Sketch, world: World) -> None:
    """Add the topics, services, actions and states that cross."""
    nodes = {f"{world.namespace.rstrip('/')}/{it.name}": it for it in sketch.nodes}
    for topic in sorted(world.graph.topics, key=lambda it: it.name):
        if topic.name in _SKIPPED or topic.name.endswith("/transition_event"):
            continue
        if own_topic(topic.name):
            continue
        if OWN_TOPIC_PREFIX in topic.name:  # NODE/offload/state, on which a node hands over its state
            _add_state(topic, world, nodes)
        else:
            _add_topic(topic, world, sketch, nodes)
    for kind in ("services", "actions"):
        _add_names(kind, world, nodes)


# -- topics -----------------------------------------------------------------------------------------------------------


def _add_topic(topic: TopicSeen, world: World, sketch: Sketch, nodes: dict[str, NodeSketch]) -> None:
    publishers, subscribers = world.publishers(topic), world.subscribers(topic)
    inside = [it for it in publishers if it in world.moved]
    outside = [it for it in publishers if it not in world.moved]
    hearers = [it for it in subscribers if it not in world.moved]
    if inside and (hearers or outside):
        nodes[inside[0]].lists["outputs"].append(_output(topic, nodes[inside[0]], outside, hearers))
        if len(inside) > 1:
            nodes[inside[0]].lists["outputs"][-1].note += f"; {plain(', '.join(inside[1:]))} publishes it too"
    elif inside:
        why = "for its own side only" if subscribers else "not subscribed to now; an output if a tool on the robot does"
        sketch.silent.append(Entry({"name": topic.name}, f"{why}; {figures(topic)}"))
    elif outside and any(it in world.moved for it in subscribers):
        sketch.to_cloud.append(_input(topic, [it for it in subscribers if it in world.moved]))
    elif not publishers and any(it in world.moved for it in subscribers):
        who = ", ".join(it for it in subscribers if it in world.moved)
        sketch.left_out.append(f"{plain(topic.name)} is heard by {plain(who)} and not published at the moment.")


def _output(topic: TopicSeen, node: NodeSketch, outside: list[str], hearers: list[str]) -> Entry:
    value: dict[str, Any] = {"topic": topic.name}
    value |= {"type": topic.type} if topic.type else {}
    notes = [figures(topic), f"heard by {plain(', '.join(hearers) or 'nobody outside')}"]
    if topic.rate_hz >= _JUDGED_FROM_HZ and not topic.latched and not outside:
        value["rate"] = min(1000, _rounded(topic.rate_hz))
        if node.fields.get("core"):
            notes.append("if it is silent between goals, add while")
    if outside:
        value["shared"] = True
        notes.append(f"also published by {plain(', '.join(outside))}")
    if topic.name.endswith("/tf") and topic.frames and not outside and len(topic.publishers) == 1:
        value["frames"] = [{"parent": parent, "child": child} for parent, child in topic.frames[:32]]
    elif topic.frames:
        notes.append(
            f"list the node's own as frames; seen: {plain(', '.join('->'.join(it) for it in topic.frames[:12]))}"
        )
    return Entry(value, "; ".join(notes))


def _input(topic: TopicSeen, hearers: list[str]) -> Entry:
    value: dict[str, Any] = {"name": topic.name}
    value |= {"type": topic.type} if topic.type else {}
    if topic.latched:
        value["latched"] = True
    elif topic.rate_hz >= _JUDGED_FROM_HZ:
        value["maxAge"] = f"{max_age_ms(topic.rate_hz)}ms"
    if topic.type in _LARGE and not topic.latched:
        value["latest"] = True
    return Entry(value, f"{figures(topic)}; for {plain(', '.join(hearers))}")


def max_age_ms(rate_hz: float) -> int:
    """Return the age of an input at which the cloud must not act: five periods in whole tenths of a second."""
    return max(_LEAST_AGE_MS, math.ceil(_PERIODS_OF_AGE * 10 / rate_hz) * 100)


def figures(topic: TopicSeen) -> str:
    """Return a topic's measurements, in words."""
    if not topic.measured:
        return plain(topic.problem) or "not measured"
    quality = next((it for it in topic.publishers if it.durability), None)
    words = f", {quality.reliability or 'unknown'} {quality.durability}" if quality else ""
    if topic.messages == 0:
        return f"silent meanwhile{words}"
    if topic.rate_hz == 0:
        return f"{topic.messages} messages, {size_text(topic.message_size)} each{words}"
    return f"{topic.rate_hz:.3g} Hz, {size_text(topic.bytes_per_s)}/s{words}"


def size_text(size: float) -> str:
    """Return bytes for people."""
    for unit, factor in (("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size:.0f} B"


def _rounded(rate_hz: float) -> int:
    """Return a rate as its author may have written it, at most the measured one: in steps of 5 Hz, below 10 Hz of 1 Hz.

    3 % are allowed for the noise of some seconds of listening.
    """
    step = 5 if rate_hz >= 9.7 else 1
    return max(1, math.floor(rate_hz * 1.03 / step) * step)


def _add_state(topic: TopicSeen, world: World, nodes: dict[str, NodeSketch]) -> None:
    for name in world.publishers(topic):
        if name in nodes and topic.name == f"{name}{OWN_TOPIC_PREFIX}state" and nodes[name].placement == "Duplicated":
            nodes[name].lists["state"].append(Entry({"snapshot": True}, figures(topic)))


# -- services and actions ---------------------------------------------------------------------------------------------


def _add_names(kind: str, world: World, nodes: dict[str, NodeSketch]) -> None:
    offered = world.servers(kind)
    calling = "clients" if kind == "services" else "action_clients"
    called = world.servers(calling)
    types = {
        name: it for node in world.graph.nodes for field in (calling, kind) for name, it in getattr(node, field).items()
    }
    for name in sorted({*offered, *called}):
        type_name = types[name]
        if type_name.startswith(_STANDARD_TYPES) or own_topic(name) or OWN_TOPIC_PREFIX in name:
            continue
        servers, clients = offered.get(name, []), called.get(name, [])
        inside = [it for it in clients if it in world.moved]
        outside = [it for it in clients if it not in world.moved]
        server = next((it for it in servers if it in world.moved), "")
        served = bool(server) and (bool(outside) or not clients)
        if served:
            nodes[server].lists[kind].append(_offer(kind, name, type_name, nodes[server], outside))
        if inside and (served or (servers and not server)):
            where = "mixed: others call it too" if served else f"offered by {plain(', '.join(servers))}"
            for client in inside:
                if client in nodes:
                    nodes[client].uses[kind].append(Entry({"name": name, "type": type_name}, where))


def _offer(kind: str, name: str, type_name: str, node: NodeSketch, clients: list[str]) -> Entry:
    value: dict[str, Any] = {"name": name, "type": type_name}
    who = f"called by {plain(', '.join(clients))}" if clients else "not called now"
    if kind == "services":
        return Entry(value, f"{who}; mode Idempotent for queries, Both for what both replicas must do")
    if node.placement == "Duplicated":
        again = type_name.rpartition("/")[2] in _CONTINUED
        value["onSwitch"] = "Continue" if again else "Abort"
        who += "" if again else "; Continue if its goal names a place, Hold if it is short"
    return Entry(value, who)
