"""Looks at a running ROS graph for some seconds and prints what it saw as JSON: `python3 look.py SECONDS > graph.json`.

A separate program for the interpreter that has ROS 2: it needs rclpy and nothing else of ours, Python 3.10 or newer,
and runs on the robot as well. It only reads: it subscribes (best effort, so that it slows down no publisher) and asks
for lifecycle states and parameters; it publishes nothing, sets nothing, starts nothing.
"""

from __future__ import annotations

import importlib
import itertools
import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import rclpy
from rclpy.action import get_action_client_names_and_types_by_node, get_action_server_names_and_types_by_node
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

VERSION: Final = 1
NODE: Final = "_robot_offload_import"
"""Hidden, like all names that begin with an underscore."""
SEARCH_S: Final = 0.2
"""How often to look for new topics: on a busy host nodes are found some seconds late."""
MOST_TOPICS: Final = 256
MOST_BYTES: Final = 16 * 1024 * 1024
"""After this much of one topic its rate and size are known well enough."""
MOST_FRAMES: Final = 256
MOST_PARAMETERS: Final = 512
ASKED_AT_ONCE: Final = 16
ANSWER_S: Final = 2.0
OF_ROS: Final = ("/rosout", "/parameter_events")
TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
LARGEST_FILE: Final = 256 * 1024
_NO_DEVICES: Final = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom", "/dev/tty", "/dev/console",
                      "/dev/ptmx")  # fmt: skip
_NO_DEVICE_FOLDERS: Final = ("/dev/shm", "/dev/pts", "/dev/mqueue")  # noqa: S108 - compared, never written


class Ear:
    """Counts the messages of one topic."""

    def __init__(self, node: Node, topic: str, type_name: str, *, latched: bool) -> None:
        package, _, name = type_name.partition("/msg/")
        message = getattr(importlib.import_module(f"{package}.msg"), name)
        self.messages, self.size, self.first_s, self.last_s = 0, 0, 0.0, 0.0
        self.frames: set[tuple[str, str]] = set()
        self._message = message if type_name == TRANSFORMS else None
        quality = QoSProfile(
            depth=20,
            reliability=ReliabilityPolicy.RELIABLE if latched else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        self.subscription = node.create_subscription(message, topic, self._hear, quality, raw=True)

    @property
    def full(self) -> bool:
        """Whether enough was received."""
        return self.size > MOST_BYTES

    def _hear(self, data: bytes) -> None:
        self.last_s = time.monotonic()
        self.first_s = self.first_s or self.last_s
        self.messages += 1
        self.size += len(data)
        if self._message is not None and len(self.frames) < MOST_FRAMES:
            for transform in deserialize_message(data, self._message).transforms:
                self.frames.add((transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")))


class Looker:
    """Our node in the graph."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node = Node(NODE, start_parameter_services=False, enable_rosout=False, use_global_arguments=False)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.ears: dict[str, Ear] = {}
        self.problems: dict[str, str] = {}

    def spin(self, until_s: float) -> None:
        """Listen until a time of the steady clock, also to topics found meanwhile."""
        search_s = 0.0
        while (now_s := time.monotonic()) < until_s:
            if now_s >= search_s:
                self.listen()
                search_s = now_s + SEARCH_S
            self.executor.spin_once(timeout_sec=0.05)
            for ear in self.ears.values():
                if ear.full and ear.subscription is not None:
                    self.node.destroy_subscription(ear.subscription)
                    ear.subscription = None

    def listen(self) -> None:
        """Subscribe to every published topic whose type this interpreter has."""
        for topic, types in self.node.get_topic_names_and_types():
            if topic in OF_ROS or "/_" in topic or topic in self.ears or topic in self.problems:
                continue
            publishers = self.node.get_publishers_info_by_topic(topic)
            if not publishers:
                continue
            if len(self.ears) >= MOST_TOPICS:
                self.problems[topic] = f"not measured: more than {MOST_TOPICS} topics"
            elif len(types) != 1:
                self.problems[topic] = "not measured: it has several types"
            else:
                latched = all(_quality(it)["durability"] == "TransientLocal" for it in publishers)
                self._listen_to(topic, types[0], latched=latched)

    def _listen_to(self, topic: str, type_name: str, *, latched: bool) -> None:
        try:
            self.ears[topic] = Ear(self.node, topic, type_name, latched=latched)
        except Exception as error:  # a foreign message package may raise anything on import
            self.problems[topic] = f"not measured: {type_name} cannot be used here ({type(error).__name__})"

    # -- the graph ----------------------------------------------------------------------------------------------------

    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return every node by its full name, with the services and actions that it offers and calls."""
        found: dict[str, dict[str, Any]] = {}
        for name, namespace in self.node.get_node_names_and_namespaces():
            if name == NODE:
                continue
            full = f"{namespace.rstrip('/')}/{name}"
            if full in found:
                found[full]["twice"] = True
                continue
            found[full] = {
                "name": full, "twice": False, "lifecycle": "", "parameters": {}, "problem": "", "participants": [],
                **self._offers(name, namespace),
            }  # fmt: skip
        return found

    def _offers(self, name: str, namespace: str) -> dict[str, Any]:
        asked = {
            "services": self.node.get_service_names_and_types_by_node,
            "clients": self.node.get_client_names_and_types_by_node,
            "actions": lambda *of: get_action_server_names_and_types_by_node(self.node, *of),
            "action_clients": lambda *of: get_action_client_names_and_types_by_node(self.node, *of),
        }
        found: dict[str, Any] = {}
        for what, ask in asked.items():
            try:
                pairs = ask(name, namespace)
            except Exception:  # it went away between two requests
                pairs = []
            found[what] = {it: types[0] for it, types in pairs if types and "/_action/" not in it}
        return found

    def topics(self, nodes: dict[str, dict[str, Any]]) -> Iterator[dict[str, Any]]:
        """Yield every topic with its publishers, subscribers and measurements."""
        for topic, types in self.node.get_topic_names_and_types():
            if "/_" in topic:
                continue
            ends = (self.node.get_publishers_info_by_topic(topic), self.node.get_subscriptions_info_by_topic(topic))
            for end in (it for side in ends for it in side):
                seen = nodes.get(_full(end))
                participant = bytes(end.endpoint_gid)[:12].hex()
                if seen is not None and participant not in seen["participants"]:
                    seen["participants"].append(participant)
            if topic in OF_ROS:
                continue
            ear = self.ears.get(topic)
            publishers, subscribers = ([_quality(it) for it in side if it.node_name != NODE] for side in ends)
            yield {
                "name": topic, "types": list(types), "publishers": publishers, "subscribers": subscribers,
                "messages": ear.messages if ear else 0, "size": ear.size if ear else 0,
                "span_s": round(ear.last_s - ear.first_s, 4) if ear else 0.0,
                "measured": ear is not None or not publishers, "problem": self.problems.get(topic, ""),
                "frames": sorted(ear.frames) if ear else [],
            }  # fmt: skip

    # -- questions to the nodes ---------------------------------------------------------------------------------------

    def ask(self, nodes: dict[str, dict[str, Any]]) -> None:
        """Ask every node for its lifecycle state and its parameters; without an answer in time they stay unknown."""
        names = list(nodes)
        for start in range(0, len(names), ASKED_AT_ONCE):
            some = [nodes[name] for name in names[start : start + ASKED_AT_ONCE]]
            self._states([it for it in some if it["services"].get(f"{it['name']}/get_state", "").startswith("life")])
            self._parameters([it for it in some if f"{it['name']}/list_parameters" in it["services"]])

    def _states(self, nodes: list[dict[str, Any]]) -> None:
        for node in nodes:
            node["lifecycle"] = "unknown"
        try:
            service = importlib.import_module("lifecycle_msgs.srv").GetState
        except ImportError:
            return
        answers = self._call(service, [(it["name"] + "/get_state", service.Request()) for it in nodes])
        for node, answer in zip(nodes, answers, strict=True):
            node["lifecycle"] = answer.current_state.label if answer is not None else "unknown"

    def _parameters(self, nodes: list[dict[str, Any]]) -> None:
        services = importlib.import_module("rcl_interfaces.srv")
        listing, getting = services.ListParameters, services.GetParameters
        lists = self._call(listing, [(it["name"] + "/list_parameters", listing.Request()) for it in nodes])
        names = [list(it.result.names)[:MOST_PARAMETERS] if it is not None else [] for it in lists]
        questions = [
            (node["name"] + "/get_parameters", getting.Request(names=own))
            for node, own in zip(nodes, names, strict=True)
        ]
        answers = self._call(getting, questions)
        for node, own, answer in zip(nodes, names, answers, strict=True):
            if answer is None:
                node["problem"] = "its parameters were not answered"
            else:
                values = {name: _value(value) for name, value in zip(own, answer.values, strict=False)}
                node["parameters"] = {name: it for name, it in values.items() if it is not None}

    def _call(self, service: Any, questions: list[tuple[str, Any]]) -> list[Any]:
        clients = [self.node.create_client(service, name) for name, _ in questions]
        try:
            end_s = time.monotonic() + ANSWER_S
            while time.monotonic() < end_s and not all(client.service_is_ready() for client in clients):
                self.executor.spin_once(timeout_sec=0.02)
            ready = [client.service_is_ready() for client in clients]
            futures = [
                client.call_async(question) if there else None
                for client, there, (_, question) in zip(clients, ready, questions, strict=True)
            ]
            while time.monotonic() < end_s and not all(it is None or it.done() for it in futures):
                self.executor.spin_once(timeout_sec=0.02)
            return [it.result() if it is not None and it.done() else None for it in futures]
        finally:
            for client in clients:
                self.node.destroy_client(client)


def _full(end: Any) -> str:
    return f"{end.node_namespace.rstrip('/')}/{end.node_name}"


def _quality(end: Any) -> dict[str, str]:
    return {
        "node": _full(end),
        "reliability": {1: "Reliable", 2: "BestEffort"}.get(int(end.qos_profile.reliability), ""),
        "durability": {1: "TransientLocal", 2: "Volatile"}.get(int(end.qos_profile.durability), ""),
    }


_VALUES: Final = ("", "bool_value", "integer_value", "double_value", "string_value", "", "bool_array_value",
                  "integer_array_value", "double_array_value", "string_array_value")  # fmt: skip


def _value(value: Any) -> Any:
    """Return a parameter's value in JSON form; None for none, and for bytes, which no parameter file can hold."""
    field = _VALUES[value.type] if value.type < len(_VALUES) else ""
    found = getattr(value, field) if field else None
    return found if found is None or isinstance(found, (bool, int, float, str)) else list(found)


# -- processes of this host -------------------------------------------------------------------------------------------


def processes() -> dict[int, dict[str, Any]]:
    """Return the ROS processes of this host, with their used processor time."""
    found = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        try:
            command = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")[:-1]
            if command and _speaks_ros(folder, command) and _in_our_domain(folder):
                found[int(folder.name)] = _process(folder, command)
        except OSError:  # it has ended, or belongs to another user
            continue
    return found


_DEFAULT_DOMAIN: Final = ("", "0") if (os.environ.get("ROS_DOMAIN_ID") or "0") == "0" else ()


def _speaks_ros(folder: Path, command: list[str]) -> bool:
    return "--ros-args" in command or "/librcl.so" in (folder / "maps").read_text(errors="replace")


def _in_our_domain(folder: Path) -> bool:
    """Return whether a process is in our ROS domain, from its environment; in a laboratory robots share machines."""
    variables = (folder / "environ").read_bytes().decode(errors="replace").split("\0")
    found = [it.partition("=")[2] for it in variables if it.startswith("ROS_DOMAIN_ID=")]
    return (found[-1] if found else "") in ((os.environ.get("ROS_DOMAIN_ID") or ""), *_DEFAULT_DOMAIN)


def _process(folder: Path, command: list[str]) -> dict[str, Any]:
    fields = (folder / "stat").read_text().rpartition(")")[2].split()
    status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line)
    return {
        "pid": int(folder.name),
        "inner_pid": int(status.get("NSpid", folder.name).split()[-1]),
        "command": command,
        "folder": str((folder / "cwd").readlink()),
        "used_s": (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"),
        "memory": int((folder / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"),
        "devices": sorted(set(_devices(folder / "fd"))),
        "parameter_files": dict(_parameter_files(folder, command)),
    }


def _devices(folder: Path) -> Iterator[str]:
    for link in folder.iterdir():
        try:
            target = str(link.readlink())
        except OSError:
            continue
        if target.startswith("/dev/") and target not in _NO_DEVICES and not target.startswith(_NO_DEVICE_FOLDERS):
            yield target


def _parameter_files(folder: Path, command: list[str]) -> Iterator[tuple[str, str]]:
    """Yield the parameter files with which a process was started: they differ from the nodes' defaults."""
    for option, name in itertools.pairwise(command):
        path = (
            folder / "root" / (folder / "cwd" / name).resolve().relative_to("/") if option == "--params-file" else None
        )
        if path is not None and path.is_file() and path.stat().st_size <= LARGEST_FILE:
            yield name, path.read_text(errors="replace")


def with_load(before: dict[int, dict[str, Any]], after: dict[int, dict[str, Any]], seconds: float) -> list[Any]:
    """Return the processes of both looks with the processor time between them, as a share of one core."""
    kept = []
    for pid, it in after.items():
        if pid in before and before[pid]["command"] == it["command"]:
            used_s = it.pop("used_s") - before[pid]["used_s"]
            kept.append({**it, "cpu": round(max(0.0, used_s) / seconds, 4)})
    return kept


def look(seconds: float) -> dict[str, Any]:
    """Look for that long and return the result."""
    looker = Looker()
    before, before_s = processes(), time.monotonic()
    looker.spin(before_s + seconds)
    after, after_s = processes(), time.monotonic()
    nodes = looker.nodes()
    topics = list(looker.topics(nodes))
    looker.ask(nodes)
    return {
        "version": VERSION,
        "seconds": round(after_s - before_s, 3),
        "host": platform.node(),
        "cores": os.cpu_count() or 1,
        "domain_id": int(os.environ.get("ROS_DOMAIN_ID") or 0),
        "rmw": rclpy.get_rmw_implementation_identifier(),
        "distro": os.environ.get("ROS_DISTRO", ""),
        "participant": _own_participant(looker.node),
        "nodes": list(nodes.values()),
        "topics": topics,
        "processes": with_load(before, after, after_s - before_s),
    }


def _own_participant(node: Node) -> str:
    ends = [it for it in node.get_publishers_info_by_topic("/parameter_events") if it.node_name == NODE]
    return bytes(ends[0].endpoint_gid)[:12].hex() if ends else ""


if __name__ == "__main__":
    json.dump(look(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0), sys.stdout)
    sys.stdout.flush()
    os._exit(0)  # a middleware that is slow to end must not cost the result
