"""The robot's ROS graph: missing types, second publishers, other lifecycle managers, their bonds, Nav2's time-outs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from robot_offload_agent.doctor.findings import Check, Finding, Level
from robot_offload_agent.ros.undeclared import Declared, Undeclared
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_agent.settings.served import SERVED
from robot_offload_core.control.tallies import IN_FLIGHT
from robot_offload_core.fence.token import Site

DISCOVERY_S = 3.0
"""How long the nodes of this network need to be found, at least."""
QUIET_S = 1.0
"""All are found when nothing new has come up for this long."""
LATE_S = 20.0
"""Limit of the search on a busy robot; a graph that never stops changing is read then."""
ANSWER_S = 10.0
OWN_NODES = ("offload_collector", "offload_control_robot", "guardian", "network_monitor", "cloud_switcher")
PLACEMENT_STATUS = "robot_offload robot: placement"
DATA_STATUS = "robot_offload robot: data"
"""See `ros/report.py`."""
MAX_DIGITS = 18
NAVIGATOR = "bt_navigator"
SERVER_TIMEOUT = "default_server_timeout"
"""Nav2's behaviour tree waits this long for the answer to a goal or a service call, ms; 20 by default
(nav2_behavior_tree, bt_action_node.hpp)."""


@dataclass(frozen=True)
class Graph:
    """What was seen in the robot's domain.

    Attributes:
        nodes: full names of all nodes.
        publishers: topic -> full names of the nodes that publish it.
        managers: managed node -> full names of others that call its lifecycle services.
        undeclared: duplicated node -> what it does beyond its declaration; only nodes that run.
        server_timeout_ms: Nav2's; None: there is no bt_navigator, or it does not answer.
        release: of the running robot agent; "": none runs, or it does not report it.
        cloud_release: of the cloud's agent, as the robot's reports; "": it was not heard yet.
        counted: the robot agent's counters, by name; empty: none runs, or it has not reported.
        problem: why nothing could be seen; empty: it could.
    """

    nodes: frozenset[str] = frozenset()
    publishers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    managers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    undeclared: Mapping[str, Undeclared] = field(default_factory=dict)
    server_timeout_ms: float | None = None
    release: str = ""
    cloud_release: str = ""
    counted: Mapping[str, int] = field(default_factory=dict)
    problem: str = ""


def full_name(namespace: str, name: str) -> str:
    """Return a node's full name; `name` may be relative."""
    return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"


def missing_types(configuration: Configuration, find: Callable[[str], Any]) -> Iterator[Finding]:
    """Try to import every declared type: of messages, services and actions.

    Args:
        configuration: of this side.
        find: imports one type by its name and raises an exception that states how to get it.
    """
    served = (getattr(configuration, group) for group in SERVED)
    declared = itertools.chain(configuration.outputs, configuration.inputs, *served)
    names = sorted({spec["type"] for spec in declared} - {"auto"})
    missing = 0
    for name in names:
        try:
            find(name)
        except Exception as error:
            missing += 1
            yield Finding(
                Check.MESSAGE_TYPES, Level.ERROR, str(error), "Source the workspace that has it, then try again."
            )
    if not missing:
        yield Finding(Check.MESSAGE_TYPES, Level.OK, f"{len(names)} declared types can be imported")


def judge(graph: Graph, configuration: Configuration) -> Iterator[Finding]:
    """Return the problems in the robot's graph. Pure."""
    if graph.problem:
        step = "Source ROS 2 in this shell, then start doctor again."
        yield Finding(Check.ROS_GRAPH, Level.UNKNOWN, f"the ROS graph cannot be seen: {graph.problem}", step)
        return
    own = {full_name(configuration["namespace"], name) for name in OWN_NODES}
    yield from _nodes(graph, configuration)
    yield from _publishers(graph, configuration, own)
    yield from _managers(graph, own)
    yield from _undeclared(graph)
    yield from _timeouts(graph, configuration)
    yield _releases(graph)
    if graph.counted:
        yield from _in_flight(graph.counted, configuration)


def _in_flight(counted: Mapping[str, int], configuration: Configuration) -> Iterator[Finding]:
    """Report open goals and calls, how often a goal began anew, and how old handed-over state was."""
    found = []
    for action in (spec["name"] for spec in configuration.actions):
        running, waiting, resent = (counted.get(f"{action}.{word}", 0) for word in IN_FLIGHT)
        found.append(f"{action} {running} executing, {waiting} waiting, {resent} restarts")
    for service in (spec["name"] for spec in configuration.services):
        found.append(f"{service} {counted.get(f'{service}.open', 0)} open calls")
    for name, what in (("open.used_goals", "goals"), ("open.used_calls", "calls")):
        if counted.get(name):
            found.append(f"{counted[name]} {what} at servers outside")
    for state in configuration.states:
        age_ms = counted.get(f"state {state.name}.age_at_change_ms")
        if age_ms is not None:
            found.append(f"state {state.name} {age_ms} ms old at the robot's last change")
    if found:
        yield Finding(Check.IN_FLIGHT, Level.OK, "; ".join(found))


def _releases(graph: Graph) -> Finding:
    """Return both sides' releases: beats, notes and envelopes are compatible only within one release."""
    if not graph.release or not graph.cloud_release:
        message = "the cloud's agent was not heard" if graph.release else "no agent of this robot was heard"
        step = "Start doctor again while the robot's agent runs and is connected: then both releases are compared."
        return Finding(Check.RELEASES, Level.UNKNOWN, message, step)
    both = f"robot {graph.release}, cloud {graph.cloud_release}"
    if graph.release == graph.cloud_release:
        return Finding(Check.RELEASES, Level.OK, both)
    step = f"Install robot-offload-agent {graph.cloud_release} on the robot."
    return Finding(Check.RELEASES, Level.WARNING, both, step)


def _nodes(graph: Graph, configuration: Configuration) -> Iterator[Finding]:
    wanted = [full_name(configuration["namespace"], node.name) for node in configuration.nodes]
    absent = [name for name in wanted if name not in graph.nodes]
    if absent:
        step = "Start the robot's nodes, or correct the names in the RobotOffload: `ros2 node list` shows them."
        yield Finding(Check.NODES, Level.WARNING, f"not running here: {', '.join(absent)}", step)
    elif wanted:
        yield Finding(Check.NODES, Level.OK, f"{len(wanted)} managed nodes run")


def _publishers(graph: Graph, configuration: Configuration, own: set[str]) -> Iterator[Finding]:
    problems = 0
    for output in configuration.outputs:
        others = sorted(set(graph.publishers.get(output["topic"], ())) - own)
        if others and not output.values.get("shared", False):
            problems += 1
            step = f"Start it with the bundle's remappings: it shall publish {output['robot_topic']}."
            message = f"{output['topic']} is published by {', '.join(others)}, beside the collector"
            yield Finding(Check.SECOND_PUBLISHER, Level.ERROR, message, step)
    if not problems and configuration.outputs:
        yield Finding(Check.SECOND_PUBLISHER, Level.OK, "nobody publishes the public topics beside the collector")


def _managers(graph: Graph, own: set[str]) -> Iterator[Finding]:
    found = {node: sorted(set(who) - own) for node, who in graph.managers.items()}
    for node, others in found.items():
        if others:
            message = f"{node} is managed by {', '.join(others)} as well"
            step = (
                f"Take {node} out of its `node_names`, and set its `bond_timeout` to 0.0: sleeping nodes hold no bond."
            )
            yield Finding(Check.SECOND_LIFECYCLE_MANAGER, Level.ERROR, message, step)
    if found and not any(found.values()):
        yield Finding(Check.SECOND_LIFECYCLE_MANAGER, Level.OK, "nobody else manages the nodes")
    bonded = sorted(set(graph.publishers.get("/bond", ())) & set(found))
    if bonded:
        message = f"{', '.join(bonded)} hold a bond with a lifecycle manager, which a change of sides breaks"
        yield Finding(Check.BONDS, Level.WARNING, message, "Set `bond_timeout: 0.0` in lifecycle_manager's parameters.")


def _undeclared(graph: Graph) -> Iterator[Finding]:
    warnings = [warning for node in graph.undeclared.values() for warning in node]
    for warning in warnings:
        message, _, step = warning.partition(". ")
        yield Finding(Check.UNDECLARED, Level.WARNING, message, f"{step}.")
    if graph.undeclared and not warnings:
        yield Finding(Check.UNDECLARED, Level.OK, "the duplicated nodes publish, serve and call what is declared")


def _timeouts(graph: Graph, configuration: Configuration) -> Iterator[Finding]:
    if graph.server_timeout_ms is None:
        return
    least_ms = configuration["activation_deadline_ms"] + configuration["loss_timeout_ms"]
    waits = f"{NAVIGATOR} waits {graph.server_timeout_ms:g} ms for its servers"
    message = f"{waits}; a change of sides may take {least_ms:g} ms"
    if graph.server_timeout_ms < least_ms:
        step = f"Set {SERVER_TIMEOUT}: {least_ms:.0f} in {NAVIGATOR}'s parameters."
        yield Finding(Check.SERVER_TIMEOUT, Level.WARNING, message, step)
    else:
        yield Finding(Check.SERVER_TIMEOUT, Level.OK, message)


def look(configuration: Configuration) -> Graph:
    """Look at the robot's graph for some seconds, read-only, with a separate node that offers nothing."""
    try:
        # Late: without a sourced ROS 2 all other checks still run.
        import rclpy  # noqa: PLC0415

        from robot_offload_agent.ros import context  # noqa: PLC0415
    except ImportError as error:
        return Graph(problem=str(error))
    assert configuration.side is Site.ROBOT
    rclpy.init(args=[], domain_id=configuration["domain_id"])
    try:
        node = context.make_node(configuration, "offload_doctor")
        executor = rclpy.executors.SingleThreadedExecutor()
        executor.add_node(node)
        told = _diagnostics(node)
        _discover(node, executor, told)
        seen = _seen(node, executor, configuration)
        said, counted = told[PLACEMENT_STATUS], told[DATA_STATUS]
        return replace(
            seen, release=said.get("release", ""), cloud_release=said.get("cloud_release", ""),
            counted={name: int(value) for name, value in counted.items() if _is_count(value)},
        )  # fmt: skip
    finally:
        rclpy.shutdown()


def _diagnostics(node: Any) -> dict[str, dict[str, str]]:
    """Return the robot agent's diagnostics: who acts, and counters; both arrive while the node is spun."""
    from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415 - see look

    told: dict[str, dict[str, str]] = {PLACEMENT_STATUS: {}, DATA_STATUS: {}}

    def take(array: Any) -> None:
        for status in array.status:
            if status.name in told:
                told[status.name].update((pair.key, pair.value) for pair in status.values)

    node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
    return told


def _is_count(word: str) -> bool:
    """Return whether a value is a count; any program may use a name on /diagnostics, so the value may be anything."""
    return word.isascii() and word.isdigit() and len(word) <= MAX_DIGITS


def _discover(node: Any, executor: Any, told: Mapping[str, Mapping[str, str]]) -> None:
    """Wait until nothing new is found and the robot's agent, if one runs, has reported everything."""
    began_s = changed_s = now_s()
    found: object = None
    while (now := now_s()) < began_s + LATE_S:
        executor.spin_once(timeout_sec=0.1)
        names = node.get_node_names_and_namespaces()
        seen = sorted(names), node.get_topic_names_and_types(), node.get_service_names_and_types()
        if seen != found:
            found, changed_s = seen, now
        heard = all(told.values()) or not any(name in OWN_NODES for name, _ in names)
        if heard and now > began_s + DISCOVERY_S and now > changed_s + QUIET_S:
            return


def _seen(node: Any, executor: Any, configuration: Configuration) -> Graph:
    names = [(name, space) for name, space in node.get_node_names_and_namespaces() if name != node.get_name()]
    topics = {output["topic"] for output in configuration.outputs} | {"/bond"}
    managed = {full_name(configuration["namespace"], spec.name) for spec in configuration.nodes if spec["lifecycle"]}
    managers: dict[str, set[str]] = {name: set() for name in managed}
    for name, space in names:
        try:
            clients = node.get_client_names_and_types_by_node(name, space)
        except RuntimeError:  # rclpy raises this for a node that has gone
            continue
        for service, _ in clients:
            target = service.removesuffix("/change_state")
            if target != service and target in managers:
                managers[target].add(full_name(space, name))
    return Graph(
        nodes=frozenset(full_name(space, name) for name, space in names),
        publishers={topic: _publishing(node.get_publishers_info_by_topic(topic)) for topic in topics},
        managers={name: tuple(sorted(who)) for name, who in managers.items()},
        undeclared=Declared(configuration, node).compare(
            {it.name: full_name(configuration["namespace"], it.name) for it in configuration.nodes if it["duplicated"]}
        ),
        server_timeout_ms=_server_timeout(node, executor, configuration["namespace"], {name for name, _ in names}),
    )


def _publishing(endpoints: Iterable[Any]) -> tuple[str, ...]:
    return tuple(full_name(each.node_namespace, each.node_name) for each in endpoints)


def _server_timeout(node: Any, executor: Any, namespace: str, names: set[str]) -> float | None:
    if NAVIGATOR not in names:
        return None
    from rcl_interfaces.srv import GetParameters  # noqa: PLC0415 - see look

    client = node.create_client(GetParameters, f"{full_name(namespace, NAVIGATOR)}/get_parameters")
    if not client.wait_for_service(ANSWER_S):
        return None
    future = client.call_async(GetParameters.Request(names=[SERVER_TIMEOUT]))
    executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
    values = future.result().values if future.done() and future.result() else []
    return float(values[0].integer_value) if values and values[0].type == 2 else None
