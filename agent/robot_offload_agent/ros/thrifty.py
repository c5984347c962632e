"""rclpy's executor with a persistent wait set.

For each wake-up rclpy collects every entity of every node, enters and leaves each and makes a new wait set: 1 ms for
the 60 entities of a control process, 50 times a second on a robot with twenty managed nodes. Here the wait set is
kept, and the executor sees only the entities that are ready.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_native
from rclpy.node import Node
from rclpy.waitable import NumberOfEntities

LONGEST_WAIT_S = 0.2
"""If the wait itself does not notice the end, it is noticed after this time."""
KINDS = ("subscriptions", "guards", "timers", "clients", "services")
"""Kinds of entities, as a node names them and in the order of a wait set's sizes."""


class Ready:
    """The ready entities of one node; the executor takes this object for the node."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.waitables: list[Any] = []
        self.subscriptions: list[Any] = []
        self.guards: list[Any] = []
        self.timers: list[Any] = []
        self.clients: list[Any] = []
        self.services: list[Any] = []

    def take(self, wait_set: Any) -> int:
        """Take what a wait has found ready; return how many there are."""
        self.waitables = [waitable for waitable in self.node.waitables if waitable.is_ready(wait_set)]
        found = len(self.waitables)
        for kind in KINDS:
            ready = wait_set.get_ready_entities(kind.removesuffix("s").replace("guard", "guard_condition"))
            entities = [one for one in getattr(self.node, kind) if one.handle.pointer in ready] if ready else []
            setattr(self, kind, entities)
            found += len(entities)
        return found


class ThriftyExecutor(SingleThreadedExecutor):
    """The executor with a kept wait set. Add nodes before it spins; entities may come and go on its own thread."""

    def __init__(self, nodes: Iterable[Node]) -> None:
        super().__init__()
        self._shown = [Ready(node) for node in nodes]
        self._bell = self._shown[0].node.create_guard_condition(lambda: None)
        self._entities: tuple[Any, ...] = ()
        self._wait_set: Any = None
        for shown in self._shown:
            self.add_node(shown.node)

    def get_nodes(self) -> list[Any]:
        """Return the ready entities in place of the nodes."""
        return list(self._shown)

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Any:
        """Have a callback executed on the thread that spins; any thread may call."""
        task = super().create_task(callback, *args, **kwargs)
        self._bell.trigger()
        return task

    def spin_while(self, goes_on: Callable[[], bool]) -> None:
        """Execute what is ready, until `goes_on` ends it or ROS is shut down."""
        try:
            while goes_on():
                self._turn()
        except (ExternalShutdownException, rclpy_native.RCLError, rclpy_native.InvalidHandle):
            if self.context.ok():
                raise

    def _turn(self) -> None:
        """Wait, then execute what is ready."""
        self._wait()
        found = sum(shown.take(self._wait_set) for shown in self._shown)
        for _ in range(found + 1):  # once more ends rclpy's own look, and executes tasks
            self.spin_once(timeout_sec=0)

    def _wait(self) -> None:
        """Wait until something is ready."""
        nodes = [shown.node for shown in self._shown]
        entities = tuple(tuple(one for node in nodes for one in getattr(node, kind)) for kind in (*KINDS, "waitables"))
        if entities != self._entities:
            self._entities, self._wait_set = entities, _made(entities, nodes[0])
        wait_set = self._wait_set
        wait_set.clear_entities()  # a wait leaves only those in it that are ready
        *plain, waitables = entities
        adds = (
            wait_set.add_subscription, wait_set.add_guard_condition, wait_set.add_timer, wait_set.add_client,
            wait_set.add_service,
        )  # fmt: skip
        for add, kind in zip(adds, plain, strict=True):
            for entity in kind:
                add(entity.handle)
        for waitable in waitables:
            waitable.add_to_wait_set(wait_set)
        wait_set.wait(int(LONGEST_WAIT_S * 1e9))


def _made(entities: tuple[tuple[Any, ...], ...], node: Node) -> Any:
    """Return an empty wait set with room for these entities."""
    size = NumberOfEntities(*(len(kind) for kind in entities[: len(KINDS)]))
    for waitable in entities[len(KINDS)]:
        size += waitable.get_num_entities()
    return rclpy_native.WaitSet(
        size.num_subscriptions, size.num_guard_conditions, size.num_timers, size.num_clients, size.num_services,
        size.num_events, node.context.handle,
    )  # fmt: skip
