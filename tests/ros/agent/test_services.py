"""A call of a client on the robot is answered once, whoever executes it, also while sides change and links are cut."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import pytest
from std_srvs.srv import Trigger
from test_msgs.srv import BasicTypes

from tests.ros.agent.clients import until
from tests.ros.agent.ears import Ear, wait_until
from tests.ros.agent.harness import World

PERIOD_S = 0.05
UNREAD = 7001
"""A call that reaches a relay which will never read it."""


class Caller:
    """Calls a service again and again with growing numbers.

    Attributes:
        asked: how many calls. answers: of each answered call, by its number.
    """

    def __init__(self, ear: Ear, kind: Any, name: str) -> None:
        self.kind = kind
        self.ear = ear
        self.client = ear.node.create_client(kind, name)
        until(self.client.service_is_ready, f"a server of {name}")
        self.asked = 0
        self.answers: dict[int, list[Any]] = {}
        self.timer = ear.node.create_timer(PERIOD_S, self._call)

    def _call(self) -> None:
        number, self.asked = self.asked, self.asked + 1
        request = self.kind.Request()
        if hasattr(request, "int32_value"):
            request.int32_value = number
        future = self.client.call_async(request)
        future.add_done_callback(lambda done: self.answers.setdefault(number, []).append(done.result()))

    def more(self, count: int = 5) -> None:
        start = len(self.answers)
        until(lambda: len(self.answers) >= start + count, "more answers")

    def stop(self) -> None:
        self.timer.cancel()

    def close(self) -> None:
        self.ear.node.destroy_timer(self.timer)
        self.ear.node.destroy_client(self.client)


@pytest.fixture
def ask(serving_world: World) -> Iterator[Caller]:
    caller = Caller(serving_world.ear, Trigger, "/ask")
    yield caller
    caller.close()


@pytest.fixture
def do(serving_world: World) -> Iterator[Caller]:
    caller = Caller(serving_world.ear, BasicTypes, "/do")
    yield caller
    caller.close()


def executed(world: World, ear: Ear, side: str) -> list[int]:
    """Returns the numbers that a side's replica has executed."""
    client = ear.node.create_client(BasicTypes, f"/offload/{side}/do")
    until(client.service_is_ready, f"the replica of the {side}")
    future = client.call_async(BasicTypes.Request(int32_value=-1))
    until(future.done, f"the answer of the {side}'s replica")
    ear.node.destroy_client(client)
    return list(map(int, future.result().string_value.split()))


@pytest.mark.core
def test_a_query_is_answered_once_through_switches_and_cuts(serving_world: World, ask: Caller) -> None:
    ask.more()
    for side in ("robot", "cloud"):
        serving_world.place(side, stay=True)
        ask.more()
    serving_world.cut("both")
    serving_world.goes_to("robot")
    serving_world.cut(None)
    serving_world.place("cloud", stay=True)
    ask.more()
    ask.stop()
    until(lambda: len(ask.answers) == ask.asked, "an answer to every call")
    assert {len(answers) for answers in ask.answers.values()} == {1}
    answerers = {int(answers[0].message.partition("#")[0]) for answers in ask.answers.values() if answers[0].success}
    assert answerers == {serving_world.nodes[side].pid for side in ("robot", "cloud")}
    assert all(answers[0].success for answers in ask.answers.values())


def test_what_must_not_be_repeated_is_executed_at_most_once(serving_world: World, do: Caller) -> None:
    do.more()
    for side in ("robot", "cloud"):
        serving_world.place(side, stay=True)
        do.more()
    serving_world.cut("both")
    serving_world.goes_to("robot")
    do.more()
    serving_world.cut(None)
    serving_world.kill("robot", "relay")
    serving_world.place("cloud", stay=True)
    do.more()
    do.stop()
    everywhere = [
        number
        for side, ear in (("robot", serving_world.ear), ("cloud", serving_world.cloud_ear()))
        for number in executed(serving_world, ear, side)
    ]
    assert len(everywhere) == len(set(everywhere))
    assert set(do.answers) <= set(everywhere)
    assert {len(answers) for answers in do.answers.values()} == {1}
    assert all(answers[0].int32_value == number for number, answers in do.answers.items())


def test_a_call_that_a_dying_relay_had_not_read_is_not_executed_and_the_next_is_answered(serving_world: World) -> None:
    ear = serving_world.ear
    client = ear.node.create_client(BasicTypes, "/do")
    until(client.service_is_ready, "a server of /do")
    answered: list[int] = []

    def call(number: int) -> None:
        request = BasicTypes.Request(int32_value=number)
        client.call_async(request).add_done_callback(lambda future: answered.append(future.result().int32_value))

    serving_world.signal("robot", "relay", signal.SIGSTOP)
    ear.executor.create_task(call, UNREAD)
    sent: list[None] = []
    ear.executor.create_task(sent.append, None)
    until(lambda: sent, "the call is sent")
    serving_world.kill("robot", "relay")
    number = UNREAD
    while number - UNREAD < 20 and not wait_until(lambda: bool(answered), 3.0):
        number += 1  # a client that gets no answer asks again
        ear.executor.create_task(call, number)
    both = (("robot", ear), ("cloud", serving_world.cloud_ear()))
    everywhere = [number for side, heard in both for number in executed(serving_world, heard, side)]
    assert set(answered) <= set(everywhere)
    assert len(answered) == len(set(answered)) > 0
    assert UNREAD not in everywhere
    ear.node.destroy_client(client)


def test_a_large_call_crosses_and_one_beyond_the_limit_is_counted(serving_world: World) -> None:
    ear = serving_world.ear
    client = ear.node.create_client(BasicTypes, "/do")
    until(client.service_is_ready, "a server of /do")
    answered: list[Any] = []

    def call(size: int) -> None:
        request = BasicTypes.Request(int32_value=size, string_value="x" * size)
        client.call_async(request).add_done_callback(lambda future: answered.append(future.result().int32_value))

    for size in (2_000_000, 900_000):
        ear.executor.create_task(call, size)
    until(lambda: answered == [900_000], "the answer to a large call")
    until(lambda: int(ear.diagnostics["data"].values["/do.TooLarge"]) >= 1, "the count of what is too large")
    ear.node.destroy_client(client)


def test_a_service_outside_is_called_by_the_side_that_holds(serving_world: World) -> None:
    """The test's nodes play the replicas: they use the private name of their side."""
    served: list[None] = []

    def light(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        served.append(None)
        response.success = True
        return response

    server = serving_world.ear.node.create_service(Trigger, "/lamp", light)
    ears = {"robot": serving_world.ear, "cloud": serving_world.cloud_ear()}
    clients = {side: ear.node.create_client(Trigger, f"/offload/{side}/lamp") for side, ear in ears.items()}

    def call(side: str) -> Trigger.Response:
        until(clients[side].service_is_ready, f"the relay of the {side}")
        answers: list[Trigger.Response] = []

        def ask() -> None:
            clients[side].call_async(Trigger.Request()).add_done_callback(lambda done: answers.append(done.result()))

        ears[side].executor.create_task(ask)
        until(lambda: bool(answers), f"an answer to a call of the {side}")
        return answers[0]

    for holder, standby in (("cloud", "robot"), ("robot", "cloud")):
        serving_world.place(holder, stay=True)
        until(lambda side=holder: call(side).success, "the holder is served")
        before = len(served)
        refused = call(standby)
        assert not refused.success
        assert "standby" in refused.message
        assert len(served) == before
    serving_world.ear.node.destroy_service(server)
    for side, ear in ears.items():
        ear.node.destroy_client(clients[side])


def test_a_node_of_the_cloud_answers_whoever_holds_and_is_refused_at_once_without_it(serving_world: World) -> None:
    """The test's node in the cloud plays the node with placement Cloud."""
    ear = serving_world.ear

    def detect(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        return response

    server = serving_world.cloud_ear().node.create_service(Trigger, "/offload/cloud/detect", detect)
    client = ear.node.create_client(Trigger, "/detect")
    until(client.service_is_ready, "the relay of the robot")
    answers: list[Trigger.Response] = []

    def call() -> Trigger.Response:
        answers.clear()
        ear.executor.create_task(
            lambda: client.call_async(Trigger.Request()).add_done_callback(lambda done: answers.append(done.result()))
        )
        until(lambda: bool(answers), "an answer")
        return answers[0]

    for holder in ("cloud", "robot"):
        serving_world.place(holder, stay=True)
        until(lambda: call().success, "the cloud's node answers")
    serving_world.cut("both")
    until(lambda: "cloud is away" in call().message, "a reason")
    serving_world.cut(None)
    until(lambda: call().success, "the cloud's node answers again")
    serving_world.cloud_ear().node.destroy_service(server)
    ear.node.destroy_client(client)
