"""Graphs for tests, built from few words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from robot_offload.survey.snapshot import GraphSnapshot, NodeSeen, ProcessSeen, TopicSeen, read

HERE = Path(__file__).parent
CONTROLLER, WHEELS = "/controller", "/wheels"
TWIST, SCAN, STRING = "geometry_msgs/msg/Twist", "sensor_msgs/msg/LaserScan", "std_msgs/msg/String"


def wheelchair() -> GraphSnapshot:
    """The example, looked at for 10 s while its nodes ran without agents."""
    return read((HERE / "wheelchair.json").read_text(), "wheelchair.json")


def node(name: str, *, managed: bool = True, **more: Any) -> NodeSeen:
    return NodeSeen(name=name, lifecycle="active" if managed else "", **more)


def topic(
    name: str,
    kind: str,
    publishers: Iterable[str],
    subscribers: Iterable[str],
    *,
    rate_hz: float = 20.0,
    size: int = 100,
    **more: Any,
) -> TopicSeen:
    """A topic that was measured for 10 s."""
    messages = round(rate_hz * 10) + 1
    values: dict[str, Any] = {
        "name": name, "types": (kind,), "messages": messages, "size": messages * size, "span_s": 10.0, "measured": True,
        "publishers": [{"node": it, "reliability": "Reliable", "durability": "Volatile"} for it in publishers],
        "subscribers": [{"node": it} for it in subscribers],
    }  # fmt: skip
    return TopicSeen.model_validate({**values, **more})


def process(pid: int, *command: str, cpu: float = 0.1, **more: Any) -> ProcessSeen:
    return ProcessSeen(pid=pid, inner_pid=pid, command=command, cpu=cpu, memory=50_000_000, **more)


def graph(
    nodes: Iterable[NodeSeen], topics: Iterable[TopicSeen] = (), processes: Iterable[ProcessSeen] = (), **more: Any
) -> GraphSnapshot:
    values: Mapping[str, Any] = {
        "seconds": 10.0,
        "host": "walker",
        "rmw": "rmw_fastrtps_cpp",
        "distro": "jazzy",
        **more,
    }
    return GraphSnapshot(nodes=tuple(nodes), topics=tuple(topics), processes=tuple(processes), **values)


def small(**more: Any) -> GraphSnapshot:
    """A laser, a controller and wheels."""
    return graph(
        [node("/laser", managed=False), node(CONTROLLER), node(WHEELS, managed=False)],
        [
            topic("/scan", SCAN, ["/laser"], [CONTROLLER], rate_hz=10.0),
            topic("/cmd_vel", TWIST, [CONTROLLER], [WHEELS]),
        ],
        **more,
    )
