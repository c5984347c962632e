"""Results of goals for a recording, asked over ROS: each goal once, none of before, a silent server costs little."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from test_msgs.action import Fibonacci

from robot_offload_agent.record.mcap import results
from robot_offload_agent.record.mcap.results import WAITING, Results
from robot_offload_agent.ros.interfaces import action_types, message_type
from robot_offload_agent.ros.raw_services import RawService
from robot_offload_agent.settings.parameters import Named

pytestmark = pytest.mark.ros
DOMAIN = 223
TYPE = "test_msgs/action/Fibonacci"
PATIENCE_S = 60.0


class Relay:
    """Answers for results, and who asks for them.

    Attributes:
        asked: requests so far. answers: whether they are answered. taken: what came into the recording.
    """

    def __init__(self, node: Node) -> None:
        self.asked: list[bytes] = []
        self.answers = True
        self.taken: list[tuple[str, str, bytes]] = []
        kinds = action_types(TYPE)
        self.service = RawService(node, kinds.get_result, "/count/_action/get_result", self._asked_for)
        action = Named("count", {"name": "/count", "type": TYPE})
        self.results = Results(node, action, lambda topic, kind, _latched, data: self.taken.append((topic, kind, data)))

    def _asked_for(self, caller: bytes, request: bytes) -> None:
        self.asked.append(request[4:20])
        if self.answers:
            result = Fibonacci.Impl.GetResultService.Response(status=4, result=Fibonacci.Result(sequence=[1, 2]))
            self.service.answer(caller, bytes(serialize_message(result)))

    def hears(self, *goals: tuple[int, int]) -> None:
        """The states of goals, (first byte of the id, status), reach the recording."""
        array = GoalStatusArray()
        for number, status in goals:
            state = GoalStatus(status=status)
            state.goal_info.goal_id.uuid = [number] * 16
            array.status_list.append(state)
        self.results.heard(bytes(serialize_message(array)))

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Serves and looks until something holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, what
            self.service.serve()
            self.results.look()
            time.sleep(0.01)


@pytest.fixture
def relay() -> Iterator[Relay]:
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = rclpy.create_node("recording_test", context=context)
    made = Relay(node)
    made.until(made.results._client.is_ready, "the server is found")
    yield made
    node.destroy_node()
    context.try_shutdown()


def test_a_goal_that_ends_is_asked_once_and_its_result_is_an_event(relay: Relay) -> None:
    relay.hears((1, 4))  # ended before we listened
    relay.hears((1, 4), (2, 2))
    relay.hears((1, 4), (2, 4))
    relay.until(lambda: bool(relay.taken), "a result")
    relay.hears((1, 4), (2, 4))
    relay.results.look()
    assert relay.asked == [bytes([2] * 16)]
    [(topic, kind, data)] = relay.taken
    assert (topic, kind) == ("/count/_action/get_result/_service_event", f"{TYPE}_GetResult_Event")
    event: Any = deserialize_message(data, message_type(kind))
    assert bytes(event.request[0].goal_id.uuid) == bytes([2] * 16)
    assert (event.response[0].status, list(event.response[0].result.sequence)) == (4, [1, 2])


def test_a_server_that_never_answers_is_asked_so_often_and_then_no_more_is_waited_for(
    relay: Relay, monkeypatch: pytest.MonkeyPatch
) -> None:
    relay.answers = False
    relay.hears()
    relay.hears(*((number, 5) for number in range(WAITING + 5)))
    relay.until(lambda: len(relay.asked) == WAITING, "the questions")
    relay.hears(*((number, 5) for number in range(WAITING + 5)))
    assert len(relay.results._asked) == WAITING
    monkeypatch.setattr(results, "PATIENCE_S", 0.0)
    relay.results.look()
    assert relay.results._asked == {}
    relay.hears(*((number, 5) for number in range(WAITING + 5)))
    relay.until(lambda: len(relay.asked) == WAITING + 5, "those that were left")
    assert len(set(relay.asked)) == WAITING + 5
    assert relay.taken == []
