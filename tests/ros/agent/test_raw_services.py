"""Services as serialized bytes: what is taken, answered and called is what rclpy's own ends read and write."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci
from unique_identifier_msgs.msg import UUID

from robot_offload_agent.errors import StartError
from robot_offload_agent.relay import cdr
from robot_offload_agent.relay.inherited import Inherited, SelfTest, find_writer
from robot_offload_agent.ros import interfaces
from robot_offload_agent.ros.native import Form, NativeError
from robot_offload_agent.ros.raw_services import Loop, RawClient, RawService
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.relay.goals.ports import ALL_GOALS, CancelCode, GoalEntry
from robot_offload_core.relay.goals.ports import GoalStatus as Status

DOMAIN = 86
PATIENCE_S = 60.0
GOAL_ID = bytes(range(16))


@pytest.fixture(scope="module")
def context() -> Iterator[Any]:
    made = rclpy.Context()
    rclpy.init(context=made, domain_id=DOMAIN)
    yield made
    rclpy.try_shutdown(context=made)


@contextmanager
def node(context: Any, name: str) -> Iterator[Node]:
    made = Node(name, context=context, enable_rosout=False, start_parameter_services=False)
    yield made
    made.destroy_node()


def straight(act: Callable[[], None]) -> None:
    act()


class Ends:
    """A loop for the raw end and an executor for the stock end."""

    def __init__(self, raw: Node, stock: Node) -> None:
        self.loop = Loop(raw)
        self.executor = SingleThreadedExecutor(context=stock.context)
        self.executor.add_node(stock)

    def until(self, condition: Callable[[], bool], also: Callable[[], object] = lambda: None) -> None:
        end_s = now_s() + PATIENCE_S
        while not condition():
            assert now_s() < end_s
            self.loop.wait(0.01, straight)
            self.executor.spin_once(timeout_sec=0.01)
            also()


def test_a_stock_client_is_answered_by_hand_and_later(context: Any) -> None:
    with node(context, "raw") as raw, node(context, "stock") as stock:
        ends = Ends(raw, stock)
        taken: list[tuple[bytes, bytes]] = []
        service = RawService(raw, GetPlan, "/plan", lambda *request: taken.append(request))
        ends.loop.services.append(service)
        client = stock.create_client(GetPlan, "/plan")
        ends.until(client.service_is_ready)
        futures = [client.call_async(GetPlan.Request(tolerance=float(number))) for number in range(3)]
        ends.until(lambda: len(taken) == 3)
        assert [deserialize_message(data, GetPlan.Request).tolerance for _, data in taken] == [0.0, 1.0, 2.0]
        plan = GetPlan.Response()
        plan.plan.poses = [PoseStamped() for _ in range(1000)]
        service.answer(taken[2][0], serialize_message(plan))
        ends.until(futures[2].done)
        assert len(futures[2].result().plan.poses) == 1000
        assert not futures[0].done()
        with pytest.raises(NativeError, match="are no GetPlan_Response"):
            service.answer(taken[0][0], b"\x00\x01\x00\x00" + b"\xff" * 40)


def test_a_stock_server_is_called(context: Any) -> None:
    with node(context, "raw2") as raw, node(context, "stock2") as stock:
        ends = Ends(raw, stock)
        client = RawClient(raw, Trigger, "/go")
        ends.loop.clients.append(client)
        assert not client.is_ready()

        def go(_request: Any, response: Any) -> Any:
            response.success, response.message = True, "went"
            return response

        stock.create_service(Trigger, "/go", go)
        ends.until(client.is_ready)
        answers: list[bytes] = []
        client.ask(Form(Trigger.Request).empty(), answers.append)
        forgotten = client.ask(Form(Trigger.Request).empty(), answers.append)
        client.forget(forgotten)
        ends.until(lambda: bool(answers))
        assert deserialize_message(answers[0], Trigger.Response).message == "went"
        assert not client.waiting


CALLER = f"""
import sys, rclpy
from std_srvs.srv import Trigger
rclpy.init(domain_id={DOMAIN})
node = rclpy.create_node("caller")
client = node.create_client(Trigger, "/slow")
client.wait_for_service()
future = client.call_async(Trigger.Request())
print("asked", flush=True)
rclpy.spin_until_future_complete(node, future, timeout_sec={PATIENCE_S})
print(future.result().message, flush=True)
"""
FIRST = f"""
import sys, rclpy
from std_srvs.srv import Trigger
from robot_offload_agent.ros.raw_services import Loop, RawService
rclpy.init(domain_id={DOMAIN})
node = rclpy.create_node("first")
loop = Loop(node)
def taken(caller, request):
    print(caller.hex(), flush=True)
loop.services.append(RawService(node, Trigger, "/slow", taken))
loop.run(lambda: float("inf"), lambda act: act())
"""


def test_a_call_that_a_dead_process_took_is_answered_by_its_successor(context: Any) -> None:
    first = subprocess.Popen([sys.executable, "-c", FIRST], stdout=subprocess.PIPE, text=True)
    caller = subprocess.Popen([sys.executable, "-c", CALLER], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout is not None
        assert caller.stdout is not None
        remembered = bytes.fromhex(first.stdout.readline())
        os.kill(first.pid, signal.SIGKILL)
        with node(context, "successor") as successor:
            service, inherited = RawService(successor, Trigger, "/slow", lambda *_: None), Inherited(successor)
            assert find_writer(successor, "/slow", bytes(24)) is None
            inherited.answer(service, remembered, serialize_message(Trigger.Response(message="from the successor")))
            end_s = now_s() + PATIENCE_S
            while inherited.waiting and now_s() < end_s:
                inherited.turn()
            assert caller.stdout.readline() == "asked\n"
            assert caller.stdout.readline() == "from the successor\n"
    finally:
        for process in (first, caller):
            with suppress(ProcessLookupError):
                process.kill()
            process.wait(PATIENCE_S)
            assert process.stdout is not None
            process.stdout.close()


@pytest.mark.parametrize(("patience_s", "passes"), [(PATIENCE_S, True), (0.0, False)])
def test_a_relay_finds_out_whether_it_can_answer_for_a_predecessor(
    context: Any, monkeypatch: pytest.MonkeyPatch, patience_s: float, passes: bool
) -> None:
    monkeypatch.setattr(SelfTest, "PATIENCE_S", patience_s)
    with node(context, "self_test") as raw:
        loop = Loop(raw)
        test = SelfTest(raw, loop, "/self_test")
        while not test.closed:
            test.turn()
            loop.wait(0.01, straight)
        assert test.passed is passes
        assert not loop.services
        assert not loop.clients


def read(data: bytes, kind: Any) -> Any:
    return deserialize_message(data, kind)


def test_the_small_messages_of_an_action_are_read_and_written_as_rclpy_does_it() -> None:
    types = interfaces.action_types("test_msgs/action/Fibonacci")
    stamp_ns, stamp = 1_700_000_000_123_456_789, Time(sec=1_700_000_000, nanosec=123_456_789)
    goal = UUID(uuid=list(GOAL_ID))
    answer = types.send_goal.Response(accepted=True, stamp=stamp)
    assert read(cdr.goal_response(True, stamp_ns), types.send_goal.Response) == answer
    assert cdr.is_accepted(serialize_message(answer))
    assert not cdr.is_accepted(cdr.goal_response(False, stamp_ns))
    request = types.get_result.Request(goal_id=goal)
    assert read(cdr.result_request(GOAL_ID), types.get_result.Request) == request
    info = GoalInfo(goal_id=goal, stamp=stamp)
    asked = serialize_message(CancelGoal.Request(goal_info=info))
    assert cdr.read_cancel_request(asked) == (GOAL_ID, stamp_ns)
    one = CancelGoal.Request(goal_info=GoalInfo(goal_id=goal))
    assert read(cdr.cancel_request(GOAL_ID), CancelGoal.Request) == one
    assert read(cdr.cancel_request(ALL_GOALS), CancelGoal.Request) == CancelGoal.Request(), "which ends all"
    entries = [GoalEntry(GOAL_ID, stamp_ns, Status.EXECUTING)] * 3
    cancelled = CancelGoal.Response(return_code=2, goals_canceling=[info] * 3)
    assert read(cdr.cancel_response(CancelCode.UNKNOWN_GOAL, entries), CancelGoal.Response) == cancelled
    assert cdr.cancel_code(serialize_message(cancelled)) is CancelCode.UNKNOWN_GOAL
    statuses = GoalStatusArray(status_list=[GoalStatus(goal_info=info, status=2)] * 3)
    assert read(cdr.status_array(entries), GoalStatusArray) == statuses
    assert read(cdr.status_array([]), GoalStatusArray) == GoalStatusArray()
    result = types.get_result.Response(status=4, result=Fibonacci.Result(sequence=[1, 1, 2]))
    assert cdr.result_status(serialize_message(result)) is Status.SUCCEEDED
    changed = read(cdr.with_status(serialize_message(result), Status.ABORTED), types.get_result.Response)
    assert (changed.status, list(changed.result.sequence)) == (6, [1, 1, 2])


@pytest.mark.parametrize("name", ["absent_msgs/action/Fly", "test_msgs/action/Absent", "test_msgs/srv/Empty", "fly"])
def test_a_type_that_is_not_there_is_named(name: str) -> None:
    with pytest.raises(StartError, match=name):
        interfaces.action_types(name)
