"""What a standby on the robot does to others, by its kind, with and without our declarations: the table of the docs."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header
from test_msgs.srv import BasicTypes

from tests.ros.agent.clients import until
from tests.ros.agent.ears import wait_until
from tests.ros.agent.harness import PATIENCE_S, PATIENT, World

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "which-nodes.md"
OUTPUTS = {"walker": "command", "hot": "hot_declared", "plain": "plain_declared"}
KINDS = tuple(OUTPUTS)
SETTLED_S = 1.5
"""What a standby does is seen within this, as each thing is done twice a second at least; on a busy machine later."""
PROGRAM = Path(__file__).with_name("effects.py")
DECLARED: dict[str, Any] = {
    "nodes": list(KINDS),
    "node.walker.core": True,
    "node.hot.standby_robot": "Hot",
    "node.hot.standby_cloud": "Hot",
    "node.plain.lifecycle": False,
    "outputs": list(OUTPUTS.values()),
    "services": [f"{kind}_serves" for kind in KINDS],
    "used_services": ["uses"],
    "used_service.uses.name": "/uses",
    "used_service.uses.type": "test_msgs/srv/BasicTypes",
    "used_service.uses.node": "walker",
}
for _kind, _output in OUTPUTS.items():
    _given = f"output.{_output}"
    DECLARED |= {
        f"{_given}.topic": f"/{_output}",
        f"{_given}.type": "std_msgs/msg/Header",
        f"{_given}.node": _kind,
        f"{_given}.robot_topic": f"/offload/robot/{_output}",
        f"{_given}.cloud_topic": f"/offload/cloud/{_output}",
        f"service.{_kind}_serves.name": f"/{_kind}_serves",
        f"service.{_kind}_serves.node": _kind,
        f"service.{_kind}_serves.type": "test_msgs/srv/BasicTypes",
        f"node.{_kind}.may_differ": ["count"],
    }


def words(heard: bool, yes: str) -> str:
    return yes if heard else "\N{EN DASH}"


def test_what_a_standby_does_to_others_is_what_the_table_says(build: Callable[..., World]) -> None:
    world = build(program=PROGRAM, both={**DECLARED, **PATIENT})
    node = world.ear.node
    heard: dict[str, set[str]] = {name: set() for name in ("declared", "undeclared", "uses", "calls", "log", "event")}
    for output in OUTPUTS.values():
        node.create_subscription(
            Header, f"/{output}", lambda said: heard["declared"].add(said.frame_id.partition(".")[0]), 10
        )
    node.create_subscription(Header, "/undeclared", lambda said: heard["undeclared"].add(said.frame_id), 50)
    kept = QoSProfile(depth=100, durability=DurabilityPolicy.VOLATILE)
    node.create_subscription(
        Log, "/rosout", lambda said: heard["log"].add(said.name) if said.msg == "acts" else None, kept
    )
    node.create_subscription(
        ParameterEvent, "/parameter_events",
        lambda said: heard["event"].add(said.node.lstrip("/")) if said.changed_parameters else None, kept,
    )  # fmt: skip

    def serves(name: str) -> Callable[[Any, Any], Any]:
        def serve(request: Any, response: Any) -> Any:
            heard[name].add(request.string_value)
            return response

        return serve

    node.create_service(BasicTypes, "/uses", serves("uses"))
    node.create_service(BasicTypes, "/uses_undeclared", serves("calls"))
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side)
    until(lambda: world.site == "cloud", "the cloud acts")
    world.place("cloud", stay=True)
    until(lambda: {f"remote_{kind}" for kind in KINDS} <= heard["declared"], "what the cloud says")
    time.sleep(SETTLED_S)  # what was on its way is over
    for found in heard.values():
        found.clear()
    written = {kind: world.folder / f"written-by-robot-{kind}" for kind in KINDS}
    for path in written.values():
        path.unlink(missing_ok=True)
    time.sleep(SETTLED_S)

    def answers(name: str) -> str:
        client = node.create_client(BasicTypes, name)
        until(client.service_is_ready, f"a server of {name}")
        calls: list[Any] = []
        node.executor.create_task(lambda: calls.append(client.call_async(BasicTypes.Request())))
        until(lambda: bool(calls) and calls[0].done(), f"an answer of {name}")
        return str(calls[0].result().string_value)

    declared = [words(answers(f"/{kind}_serves") == "robot", "answers") for kind in KINDS]
    other = [words(answers(f"/{kind}_serves_undeclared") == "robot", "answers") for kind in KINDS]

    def table() -> str:
        rows = {
            "declared output": [words(kind in heard["declared"], "heard") for kind in KINDS],
            "other topic": [words(f"robot {kind}" in heard["undeclared"], "heard") for kind in KINDS],
            "declared service": declared,
            "other service": other,
            "call of a declared used service": [words(f"robot {kind}" in heard["uses"], "made") for kind in KINDS],
            "other call": [words(f"robot {kind}" in heard["calls"], "made") for kind in KINDS],
            "line in the log": [words(kind in heard["log"], "heard") for kind in KINDS],
            "parameter event": [words(kind in heard["event"], "heard") for kind in KINDS],
            "file, hardware": [words(path.exists(), "touched") for path in written.values()],
        }
        return "".join(f"| {effect} | {' | '.join(cells)} |\n" for effect, cells in rows.items())

    page = PAGE.read_text(encoding="utf-8")
    # What was seen once stays seen, so this waits for what is late and never for what must not be.
    assert wait_until(lambda: table() in page, PATIENCE_S), f"the page needs this table:\n{table()}"
    assert world.site == "cloud"
