"""The agent's executor serves what rclpy's serves: two nodes in one process, their entities of every kind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import Int32
from std_srvs.srv import SetBool

from robot_offload_agent.ros.thrifty import LONGEST_WAIT_S, ThriftyExecutor

pytestmark = [pytest.mark.ros, pytest.mark.core]

DOMAIN_ID = 43
PATIENCE_S = 60.0


class Pair:
    """A lifecycle node and a plain one, spun on a thread until the test ends."""

    def __init__(self) -> None:
        rclpy.init(domain_id=DOMAIN_ID)
        self.near, self.far = LifecycleNode("near"), Node("far")
        self.goes_on = True
        self.far.create_service(SetBool, "turn", self.turn)
        self.client = self.near.create_client(SetBool, "turn")
        self.executor = ThriftyExecutor([self.near, self.far])
        self.threads: set[str] = set()
        self.thread = threading.Thread(target=self.spin, name="spins")
        self.thread.start()

    def spin(self) -> None:
        self.executor.spin_while(lambda: self.goes_on)

    def turn(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.threads.add(threading.current_thread().name)
        response.success = request.data
        return response

    def ask(self, data: bool = True) -> Any:
        return self.client.call_async(SetBool.Request(data=data))

    def until(self, holds: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < deadline_s
            time.sleep(0.01)

    def close(self) -> None:
        self.goes_on = False
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair()
    yield made
    made.close()
    made.near.destroy_node()
    made.far.destroy_node()
    rclpy.try_shutdown()


def test_calls_of_another_thread_are_answered_on_the_one_that_spins(pair: Pair) -> None:
    assert pair.client.wait_for_service(PATIENCE_S)
    answers: list[bool] = []
    for number in range(50):
        pair.ask(number % 2 == 0).add_done_callback(lambda future: answers.append(future.result().success))
        pair.until(lambda number=number: len(answers) == number + 1)  # type: ignore[misc]
    assert answers == [True, False] * 25
    assert pair.threads == {"spins"}


def test_a_hundred_calls_at_once_are_all_answered(pair: Pair) -> None:
    assert pair.client.wait_for_service(PATIENCE_S)
    futures = []
    for _ in range(100):
        futures.append(pair.ask())
        time.sleep(0.001)  # the service keeps ten
    pair.until(lambda: all(future.done() for future in futures))


def test_messages_timers_and_tasks_are_served_beside_each_other(pair: Pair) -> None:
    heard: list[int] = []
    ticks: list[float] = []
    done: list[str] = []
    pair.far.create_subscription(Int32, "numbers", lambda message: heard.append(message.data), 10)
    publisher = pair.near.create_publisher(Int32, "numbers", 10)
    pair.near.create_timer(0.02, lambda: ticks.append(time.monotonic()))
    pair.until(lambda: publisher.get_subscription_count() == 1)
    for number in range(20):
        publisher.publish(Int32(data=number))
        pair.executor.create_task(lambda number=number: done.append(f"task {number}"))
        pair.until(lambda number=number: number in heard and f"task {number}" in done)  # type: ignore[misc]
    assert heard == list(range(20))
    pair.until(lambda: len(ticks) > 5)


def test_what_is_created_while_it_waits_is_served_and_what_is_destroyed_is_not(pair: Pair) -> None:
    heard: list[str] = []
    late = pair.far.create_subscription(Int32, "late", lambda _: heard.append("late"), 10)
    publisher = pair.near.create_publisher(Int32, "late", 10)
    pair.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Int32())
    pair.until(lambda: heard == ["late"])
    gone = threading.Event()
    pair.executor.create_task(lambda: (pair.far.destroy_subscription(late), gone.set()))
    assert gone.wait(PATIENCE_S)
    pair.until(lambda: publisher.get_subscription_count() == 0)
    publisher.publish(Int32())
    time.sleep(2 * LONGEST_WAIT_S)
    assert heard == ["late"]


def test_a_task_may_wait_for_an_answer_that_the_same_thread_has_to_give(pair: Pair) -> None:
    assert pair.client.wait_for_service(PATIENCE_S)
    said: list[bool] = []

    async def ask() -> None:
        answer = await pair.ask(False)
        said.append(answer.success)

    pair.executor.create_task(ask)
    pair.until(lambda: said == [False])


def test_parameters_of_a_node_are_served(pair: Pair) -> None:
    pair.far.declare_parameter("speed", 1.0)
    asking = AsyncParameterClient(pair.near, "far")
    assert asking.wait_for_services(PATIENCE_S)
    future = asking.set_parameters([Parameter("speed", value=2.5)])
    pair.until(future.done)
    assert pair.far.get_parameter("speed").value == 2.5


def test_a_callback_that_fails_ends_the_spinning(pair: Pair) -> None:
    def fail() -> None:
        raise RuntimeError("on purpose")

    failures: list[BaseException] = []
    before, threading.excepthook = threading.excepthook, lambda args: failures.append(args.exc_value)  # type: ignore[arg-type]
    try:
        pair.near.create_timer(0.01, fail)
        pair.thread.join(PATIENCE_S)
    finally:
        threading.excepthook = before
    assert [str(failure) for failure in failures] == ["on purpose"]


def test_the_end_of_ros_ends_the_spinning(pair: Pair) -> None:
    rclpy.shutdown()
    pair.thread.join(PATIENCE_S)
    assert not pair.thread.is_alive()
