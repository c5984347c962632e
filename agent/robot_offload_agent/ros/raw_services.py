"""Services and clients whose requests and responses are serialized bytes, taken and answered by hand.

Some calls get no answer, others one after minutes; rclpy's callbacks can do neither without blocking.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_native
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from robot_offload_agent.ros import native
from robot_offload_agent.ros.native import Form
from robot_offload_agent.runtime.clock import now_s

QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""Deeper than rclpy's: a hundred clients may call between two turns of the loop."""
MOST_AT_ONCE = 10
"""Messages of one topic that are handled before others get their turn."""
LONGEST_WAIT_S = 0.1
"""If the wait itself does not notice the end, it is noticed after this time."""


class RawService:
    """A server of one service.

    Attributes:
        name: full name.
        on_request: called with the request's id and its bytes, on the thread of the loop.
    """

    def __init__(self, node: Node, kind: Any, name: str, on_request: Callable[[bytes, bytes], None]) -> None:
        self.node, self.name, self.on_request = node, name, on_request
        self.request, self.response = Form(kind.Request), Form(kind.Response)
        self.entity = node.create_service(kind, name, _unused, qos_profile=QOS)

    def serve(self) -> None:
        """Take all requests that are there."""
        while (taken := native.take_request(self.entity.handle.pointer, self.request)) is not None:
            self.on_request(*taken)

    def answer(self, request: bytes, response: bytes) -> None:
        """Answer the request of that id; raise NativeError."""
        native.send_response(self.entity.handle.pointer, self.response, request, response)


class RawClient:
    """A client of one service.

    Attributes:
        name: full name.
        waiting: callbacks that take the response's bytes, by sequence number.
    """

    def __init__(self, node: Node, kind: Any, name: str) -> None:
        self.node, self.name = node, name
        self.request, self.response = Form(kind.Request), Form(kind.Response)
        self.entity = node.create_client(kind, name, qos_profile=QOS)
        self.waiting: dict[int, Callable[[bytes], None]] = {}

    def is_ready(self) -> bool:
        """Return whether a server is there and both its directions have been found."""
        return bool(self.entity.service_is_ready())

    def ask(self, request: bytes, on_response: Callable[[bytes], None]) -> int:
        """Send a request; return its sequence number; raise NativeError."""
        sequence = native.send_request(self.entity.handle.pointer, self.request, request)
        self.waiting[sequence] = on_response
        return sequence

    def forget(self, sequence: int) -> None:
        """Stop waiting for a response."""
        self.waiting.pop(sequence, None)

    def serve(self) -> None:
        """Take all responses that are there; leave out those that are not waited for."""
        while (taken := native.take_response(self.entity.handle.pointer, self.response)) is not None:
            on_response = self.waiting.pop(taken[0], None)
            if on_response is not None:
                on_response(taken[1])


def _unused(request: Any, response: Any) -> Any:
    raise NotImplementedError  # an executor would call it; the loop below takes by hand


class Loop:
    """Waits for subscriptions, services and clients of one node, and for `wake`; passes on what arrives.

    One thread and no executor: no callback can wait for another, so none can block for ever.
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        self.guard = node.create_guard_condition(lambda: None)
        self.services: list[RawService] = []
        self.clients: list[RawClient] = []
        self.waits: tuple[tuple[Any, ...], Any] = ((), None)

    def wake(self) -> None:
        """End the present wait; any thread may call."""
        self.guard.trigger()

    def run(self, turn: Callable[[], float], guarded: Callable[[Callable[[], None]], None]) -> None:
        """Serve until rclpy is shut down.

        Args:
            turn: called after each wait; returns the latest time of its next call, on the steady clock.
            guarded: calls the function that takes one entity's messages, and keeps what it raises.
        """
        due_s = turn()
        while rclpy.ok():
            self.wait(max(0.0, min(LONGEST_WAIT_S, due_s - now_s())), guarded)
            due_s = turn()

    def wait(self, wait_s: float, guarded: Callable[[Callable[[], None]], None]) -> None:
        """Wait, and pass on what arrived."""
        subscriptions, services, clients = tuple(self.node.subscriptions), tuple(self.services), tuple(self.clients)
        if self.waits[0] != (subscriptions, services, clients):
            size = len(subscriptions), 1, 0, len(clients), len(services), 0
            self.waits = (subscriptions, services, clients), rclpy_native.WaitSet(*size, self.node.context.handle)
        wait_set = self.waits[1]
        wait_set.clear_entities()  # a wait leaves only those in it that are ready
        wait_set.add_guard_condition(self.guard.handle)
        for subscription in subscriptions:
            wait_set.add_subscription(subscription.handle)
        for client in clients:
            wait_set.add_client(client.entity.handle)
        for service in services:
            wait_set.add_service(service.entity.handle)
        wait_set.wait(int(wait_s * 1e9))
        self._hand_on(wait_set, services, clients, subscriptions, guarded)

    def _hand_on(
        self, wait_set: Any, services: Iterable[RawService], clients: Iterable[RawClient],
        subscriptions: Iterable[Any], guarded: Callable[[Callable[[], None]], None],
    ) -> None:  # fmt: skip
        ready = set(wait_set.get_ready_entities("service"))
        for service in services:
            if service.entity.handle.pointer in ready:
                guarded(service.serve)
        ready = set(wait_set.get_ready_entities("client"))
        for client in clients:
            if client.entity.handle.pointer in ready:
                guarded(client.serve)
        ready = set(wait_set.get_ready_entities("subscription"))
        for subscription in subscriptions:
            if subscription.handle.pointer in ready:
                guarded(lambda subscription=subscription: _take_all(subscription))  # type: ignore[misc]


def _take_all(subscription: Any) -> None:
    for _ in range(MOST_AT_ONCE):
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return
        subscription.callback(taken[0])
