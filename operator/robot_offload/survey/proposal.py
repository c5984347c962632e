"""From a graph to a sketch of its RobotOffload: which node goes where, and what crosses between the sides."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final, get_args

from robot_offload.api.v1alpha1.names import MAX_NAME_LENGTH
from robot_offload.api.v1alpha1.robotoffload import FAST_DDS, RobotSide
from robot_offload.errors import RobotOffloadError
from robot_offload.survey import crossing, starting
from robot_offload.survey.owners import owners
from robot_offload.survey.roles import Kind, Role, roles
from robot_offload.survey.seen import World
from robot_offload.survey.sketch import NodeSketch, Sketch, plain
from robot_offload.survey.snapshot import GraphSnapshot, NodeSeen

MOST_NODES: Final = 64
"""The maximum of a RobotOffload."""
NO_LIFECYCLE: Final = (
    "it has no lifecycle: Duplicated it would run on both sides all the time, with placement Cloud it would end with "
    "the link"
)
_FULL_NAME: Final = re.compile(r"/.*[^/]")
_DISTROS: Final = get_args(RobotSide.model_fields["ros_distro"].annotation)


class SurveyError(RobotOffloadError):
    """Nothing can be proposed for the graph."""


def propose(graph: GraphSnapshot, name: str = "", folder: str = "") -> Sketch:
    """Return a proposed RobotOffload: every node with a lifecycle and no reason to stay is duplicated.

    Args:
        graph: as seen.
        name: the robot's name; empty: made from the host's.
        folder: of the future file: programs are named from there, or else by their whole path.

    Raises:
        SurveyError: there is no node in the graph.
    """
    graph = _sane(graph)
    world = _world(graph, folder)
    sketch = Sketch(name or _resource_name(graph.host), head=_head(graph))
    sketch.spec = _blocks(world, sketch)
    kept, rest = _chosen(world)
    for node in kept:
        sketch.nodes.append(_node(world, node))
    crossing.add_to(sketch, world)
    _times(sketch)
    sketch.left_out += [_left_out(world, node) for node in rest]
    return sketch


def _sane(graph: GraphSnapshot) -> GraphSnapshot:
    """Return the graph with each node once, and only nodes with a full name."""
    nodes: dict[str, NodeSeen] = {}
    for node in graph.nodes:
        if _FULL_NAME.match(node.name):
            nodes[node.name] = node.model_copy(update={"twice": True}) if node.name in nodes else node
    return graph.model_copy(update={"nodes": tuple(nodes.values())})


def _world(graph: GraphSnapshot, folder: str) -> World:
    owned = owners(graph)
    known = roles(graph, owned)
    nodes = [node for node in graph.nodes if known[node.name].kind is not Kind.OURS]
    if not nodes:
        raise SurveyError(
            f"no node was seen in ROS domain {graph.domain_id} ({graph.rmw or 'unknown middleware'}) within "
            f"{graph.seconds:g} s; start the robot's nodes, and use their ROS_DOMAIN_ID and RMW_IMPLEMENTATION in this "
            "shell"
        )
    namespace = _namespace(nodes, known)
    moved = {
        node.name: "Duplicated"
        for node in nodes
        if _leaves(node, known) and _space(node.name) == namespace and owned.whole.get(node.name) == node.name
    }
    return World(graph, owned, known, namespace, _one_speaker(graph, owned.whole, moved), folder)


def _leaves(node: NodeSeen, known: Mapping[str, Role]) -> bool:
    return node.managed and known[node.name].kind is Kind.FREE and not node.twice


def _one_speaker(graph: GraphSnapshot, whole: Mapping[str, str], moved: Mapping[str, str]) -> dict[str, str]:
    """Let only one of several publishers of an externally heard topic leave: the owner of the busiest topics.

    An output has one node: otherwise nobody could decide whose messages pass.
    """
    kept = dict(moved)
    said: dict[str, int] = {}
    for topic in graph.topics:
        for end in topic.publishers:
            said[whole.get(end.node, end.node)] = said.get(whole.get(end.node, end.node), 0) + topic.messages
    for topic in sorted(graph.topics, key=lambda it: -it.messages):
        speakers = sorted({it for end in topic.publishers if (it := whole.get(end.node, end.node)) in kept})
        outside = [it for end in topic.subscribers if (it := whole.get(end.node, end.node)) not in kept]
        if len(speakers) > 1 and outside and topic.name not in ("/tf", "/tf_static", "/diagnostics"):
            for other in sorted(speakers, key=lambda it: (-said.get(it, 0), it))[1:]:
                del kept[other]
    return kept


def _namespace(nodes: list[NodeSeen], known: Mapping[str, Role]) -> str:
    """Return the robot's namespace: the one with most of the nodes that can leave, or else with most nodes."""
    counted: dict[str, tuple[int, int]] = {}
    for node in nodes:
        free, all_of_it = counted.get(_space(node.name), (0, 0))
        counted[_space(node.name)] = (free + _leaves(node, known), all_of_it + 1)
    return min(counted, key=lambda it: (-counted[it][0], -counted[it][1], len(it), it))


def _space(node: str) -> str:
    return node.rpartition("/")[0] or "/"


def _chosen(world: World) -> tuple[list[NodeSeen], list[NodeSeen]]:
    """Return the nodes of the file, and those for which it has no room or no form."""
    nodes = [it for it in world.graph.nodes if world.roles[it.name].kind is not Kind.OURS]
    fits = [it for it in nodes if _space(it.name) == world.namespace and world.owned.whole[it.name] == it.name]
    near = world.neighbours()
    order = sorted(fits, key=lambda it: (it.name not in world.moved, it.name not in near, it.name))
    kept = {it.name for it in order[:MOST_NODES]}
    for name in [name for name in world.moved if name not in kept]:
        del world.moved[name]
    listed = sorted((it for it in fits if it.name in kept), key=lambda it: (it.name in world.moved, it.name))
    return listed, [it for it in nodes if it.name not in kept]


def _head(graph: GraphSnapshot) -> list[str]:
    measured = sum(topic.measured for topic in graph.topics)
    seen = f"{len(graph.nodes)} nodes, {len(graph.topics)} topics ({measured} measured), {plain(graph.rmw)}"
    line = (
        f"Proposed by `robot-offload import` from {graph.seconds:.1f} s of a running graph: {seen}, domain "
        f"{graph.domain_id}. What was idle meanwhile was not seen at work: read every line, then run `robot-offload "
        "validate`."
    )
    return [line]


def _blocks(world: World, sketch: Sketch) -> dict[str, dict[str, Any]]:
    graph = world.graph
    robot: dict[str, Any] = {"rosDistro": graph.distro} if graph.distro in _DISTROS else {}
    robot |= {"rmw": graph.rmw} if graph.rmw else {}
    robot |= {"domainID": graph.domain_id}
    robot |= {"namespace": world.namespace} if world.namespace != "/" else {}
    if graph.distro and graph.distro not in _DISTROS:
        sketch.notes["robot"] = f"ROS 2 {plain(graph.distro)} is not one of {', '.join(_DISTROS)}"
    blocks: dict[str, dict[str, Any]] = {"robot": robot, "cloud": {}, "transport": {"type": "Zenoh"}, "driver": {}}
    if graph.rmw and graph.rmw not in FAST_DDS:
        blocks["cloud"] = {"rmw": FAST_DDS[0]}
        sketch.notes["cloud"] = "a cluster needs Fast DDS"
    stops = [name for node in graph.nodes for name, kind in node.services.items() if kind == "std_srvs/srv/SetBool"]
    stop = next((it for it in sorted(stops) if re.search(r"inhibit|stop|halt|disable_motor", it)), "")
    if stop:
        blocks["driver"] = {"inhibitService": stop}
        sketch.notes["driver"] = "must stop the robot for data: true, and hold it; look into the driver"
    elif any(world.core(it) for it in world.moved):
        sketch.left_out.append(
            "No service that stops the robot was recognised (std_srvs/srv/SetBool); name it in spec.driver."
            "inhibitService: it is called when a core node is not active."
        )
    return blocks


def _node(world: World, node: NodeSeen) -> NodeSketch:
    placement, role = world.moved.get(node.name, "Robot"), world.roles[node.name]
    sketch = NodeSketch(node.name.rpartition("/")[2], placement)
    if placement == "Robot":
        reason = role.reason or (_why_alone(node) if node.managed else NO_LIFECYCLE)
        sketch.notes.append(f"stays on the robot: {plain_words(reason)}")
    if world.core(node.name):
        sketch.fields["core"] = True
        sketch.notes.append("core: it commands what moves the robot, which stops without it")
    if not node.managed:
        sketch.fields["lifecycle"] = False
    parts = sorted(it for it, whole in world.owned.whole.items() if whole == node.name and it != node.name)
    if parts:
        sketch.notes.append(f"with its parts {plain(', '.join(parts))}")
    starting.add_to(sketch, world, node)
    return sketch


def _why_alone(node: NodeSeen) -> str:
    if node.twice:
        return "two nodes have this name; rename one"
    return "another node that leaves publishes one of its topics too, or the best cut leaves it here"


def plain_words(text: str) -> str:
    """Return a reason in a form that fits a comment."""
    shown = ascii(text)[1:-1]
    return shown if len(shown) <= 240 else f"{shown[:236]}..."


def _times(sketch: Sketch) -> None:
    """Propose the robot's period from the commands; the cloud's is not yet measured."""
    rates = [it.value["rate"] for node in sketch.nodes if node.fields.get("core") for it in node.lists["outputs"]
             if "rate" in it.value]  # fmt: skip
    if rates:
        period = f"{max(1, min(10_000, round(1000 / min(rates))))}ms"
        sketch.spec["switching"] = {"latency": {"robotPeriod": period, "cloudPeriod": period}}
        sketch.notes["switching"] = (
            "periods of the commands as seen; lower cloudPeriod when the cloud's replica is faster, and raise "
            "tolerance by what the robot's speed allows"
        )


def _left_out(world: World, node: NodeSeen) -> str:
    name = plain(node.name)
    if world.owned.whole[node.name] != node.name:
        return f"Not listed: {name}, a part of {plain(world.owned.whole[node.name])}."
    if _space(node.name) != world.namespace:
        return f"Not listed: {name}, which is not in the robot's namespace {plain(world.namespace)}; it stays as it is."
    return f"Not listed: {name}; a RobotOffload has at most {MOST_NODES} nodes, and it stays as it is."


def _resource_name(host: str) -> str:
    name = re.sub(r"[^a-z0-9-]+", "-", host.lower()).strip("-")[:MAX_NAME_LENGTH].strip("-")
    return name or "robot"
