"""Actions and services of a user's own interface package, which was made a moment ago."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import ActionClient

from robot_offload_lab.run import interfaces
from tests.ros.agent.clients import SUCCEEDED, until
from tests.ros.agent.harness import PATIENT, World

EXIT_S = 60.0
OWN = interfaces.Package(
    "made_on_the_spot",
    {
        "action/Dig.idl": """#include "builtin_interfaces/msg/Time.idl"
module made_on_the_spot { module action {
  struct Dig_Goal { builtin_interfaces::msg::Time started; sequence<double> depths; };
  struct Dig_Result { string done; };
  struct Dig_Feedback { uint32 spoonfuls; double depth; };
}; };
""",
        "srv/Ask.idl": """module made_on_the_spot { module srv {
  struct Ask_Request { string question; };
  struct Ask_Response { boolean success; string answer; };
}; };
""",
    },
)
DECLARED: dict[str, Any] = {
    "actions": ["dig"],
    "action.dig.name": "/dig",
    "action.dig.type": "made_on_the_spot/action/Dig",
    "action.dig.on_switch": "Resend",
    "action.dig.node": "walker",
    "action.dig.core": True,
    "services": ["why"],
    "service.why.name": "/why",
    "service.why.type": "made_on_the_spot/srv/Ask",
    "service.why.mode": "Idempotent",
    "service.why.node": "walker",
    "service.why.core": True,
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The package, on the search paths of this process and of those that it starts."""
    folder = interfaces.make(tmp_path_factory.mktemp("interfaces"), OWN)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in interfaces.environment(folder).items():
            patch.setenv(name, value)
        patch.syspath_prepend(str(folder))
        interfaces.load(folder, OWN)
        yield folder


def test_goals_and_calls_of_a_package_made_on_the_spot_go_on_through_switches(
    made: Path, build: Callable[..., World]
) -> None:
    assert made.exists()
    dig = importlib.import_module("made_on_the_spot.action").Dig
    ask = importlib.import_module("made_on_the_spot.srv").Ask
    world = build(program=Path(__file__).with_name("digging.py"), both={**DECLARED, **PATIENT}).start()
    node = world.ear.node
    client = ActionClient(node, dig, "/dig")
    until(client.server_is_ready, "a server of /dig")
    results: list[tuple[int, str]] = []
    depths: list[float] = []

    def send() -> None:
        goal = dig.Goal(depths=[step / 8 for step in range(400)])
        sent = client.send_goal_async(goal, feedback_callback=lambda heard: depths.append(heard.feedback.depth))
        sent.add_done_callback(lambda answer: answer.result().get_result_async().add_done_callback(ended))

    def ended(future: Any) -> None:
        results.append((future.result().status, future.result().result.done))

    node.executor.create_task(send)
    until(lambda: len(depths) > 5, "feedback")
    answers = []
    for side in ("robot", "cloud"):
        world.place(side, stay=True)
        heard = len(depths)
        until(lambda begun=heard: len(depths) > begun + 5, "more feedback")  # type: ignore[misc]
        asked = node.create_client(ask, "/why")
        until(asked.service_is_ready, "a server of /why")
        calls: list[Any] = []
        node.executor.create_task(lambda: calls.append(asked.call_async(ask.Request(question="why"))))  # noqa: B023
        until(lambda: bool(calls) and calls[0].done(), "an answer")  # noqa: B023
        answers.append(calls[0].result().answer)
    until(lambda: bool(results), "the result")
    assert answers == [f"why: {world.nodes[side].pid}" for side in ("robot", "cloud")]
    assert results == [(SUCCEEDED, f"{world.nodes['cloud'].pid} to 49.875")]
    client.destroy()


def test_an_agent_without_the_package_does_not_start_and_names_it(build: Callable[..., World]) -> None:
    world = build(both=DECLARED, environment={"robot": {"PYTHONPATH": ""}})
    assert world.start_agent("robot").wait(EXIT_S) == 4
    said = world.processes.log("robot-agent")
    assert "cannot be imported here: no installed package made_on_the_spot has it" in said
