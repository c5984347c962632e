"""An emulated DDS link: carries declared topics between the two sides' ROS domains, with delay, loss and cuts.

Stands in for a DDS router on a bad network where the agents' link is itself made of topics (every transport but
Zenoh). It shares the model of the link with `wire`. Every message is a datagram. Lost reliable messages are sent again
once a later message of their topic (or a heartbeat) has got through; the newest `DEPTH` survive, as in a history of
that depth. What DDS itself adds (acknowledgements, discovery over the link) is not modelled.

A process of its own: `python -m robot_offload_lab.wire.dds CONFIG.json`. Standard input takes `{"start": steady
time}`, which starts the schedule's clock; its end ends the process.
"""

from __future__ import annotations

import heapq
import importlib
import itertools
import json
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from robot_offload_lab.wire.dds_options import Carried, DdsWireConfig
from robot_offload_lab.wire.link import Direction, EmulatedLink
from robot_offload_lab.wire.loop import steady_s

DEPTH = 10
HEARTBEAT_S = 3.0
"""Fast DDS's default period of a reliable writer's heartbeats; each message carries another one."""
RESOLVE_S = 0.25
CLOSE_S = 2.0
NODE_NAME = "offload_dds_wire"


class Delayer:
    """Calls back at given moments, in their order, on a thread of its own."""

    def __init__(self) -> None:
        self._ended = False
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="delay", daemon=True)
        self._thread.start()

    def at(self, when_s: float, action: Callable[[], None]) -> None:
        """Call `action` at `when_s` (steady clock)."""
        with self._changed:
            heapq.heappush(self._due, (when_s, next(self._order), action))
            self._changed.notify()

    def close(self) -> None:
        """Stop calling back."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._ended and (not self._due or self._due[0][0] > steady_s()):
                    self._changed.wait(max(0.0, self._due[0][0] - steady_s()) if self._due else None)
                if self._ended:
                    return
                _, _, action = heapq.heappop(self._due)
            action()


class Carrier:
    """One topic on its way. Everything but the subscription's callback happens on the delayer's thread."""

    def __init__(self, carried: Carried, source: Node, target: Node, link: EmulatedLink, delayer: Delayer) -> None:
        self._carried = carried
        self._source = source
        self._target = target
        self._link = link
        self._delayer = delayer
        self._held: deque[bytes] = deque(maxlen=DEPTH)
        self._reliable = False
        self._publisher: Any = None

    def resolve(self) -> bool:
        """Create both ends as soon as type and quality of service are known; return whether that has happened."""
        if self._publisher is not None:
            return True
        infos = self._source.get_publishers_info_by_topic(self._carried.topic)
        types = {info.topic_type for info in infos}
        name = self._carried.type or (types.pop() if len(types) == 1 else "")
        if not name or not (infos or self._carried.reliability):
            return False
        self._reliable = self._carried.reliability == "reliable" or (
            not self._carried.reliability
            and all(info.qos_profile.reliability is ReliabilityPolicy.RELIABLE for info in infos)
        )
        quality = QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if self._reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if self._carried.latched else DurabilityPolicy.VOLATILE,
        )
        kind, topic = _message_class(name), self._carried.topic
        self._publisher = self._target.create_publisher(kind, topic, quality)
        self._source.create_subscription(kind, topic, self._heard, quality, raw=True)
        return True

    def _heard(self, data: bytes) -> None:
        self._delayer.at(steady_s(), lambda: self._offer(data))

    def _offer(self, data: bytes) -> None:
        now_s = steady_s()
        arrives_s = self._link.datagram(self._carried.direction, now_s, len(data))
        if not self._reliable:
            self._deliver(arrives_s, [data])
            return
        self._held.append(data)
        if arrives_s is not None:
            self._release(now_s, arrives_s)
        elif len(self._held) == 1:
            self._delayer.at(now_s + HEARTBEAT_S, self._beat)

    def _beat(self) -> None:
        """Ask for what is missing, like the writer's heartbeat, in case nothing newer has come since the loss."""
        if not self._held:
            return
        now_s = steady_s()
        arrives_s = self._link.datagram(self._carried.direction, now_s, 0)
        if arrives_s is None:
            self._delayer.at(now_s + HEARTBEAT_S, self._beat)
        else:
            self._release(now_s, arrives_s)

    def _release(self, now_s: float, arrives_s: float) -> None:
        """Release what the reader now asks for; it arrives one round trip later."""
        missing = len(self._held) > 1
        up, down = self._link.conditions(now_s)
        round_trip_s = (up.delay_ms + down.delay_ms) / 1e3
        self._deliver(arrives_s + round_trip_s * missing, list(self._held))
        self._held.clear()

    def _deliver(self, when_s: float | None, messages: Sequence[bytes]) -> None:
        """Publish `messages` at that moment; None: they are lost."""
        if when_s is None:
            return

        def publish() -> None:
            for data in messages:
                self._publisher.publish(data)

        self._delayer.at(when_s, publish)


class DdsWire:
    """Both domains, with one thread each, and the delayer between them."""

    def __init__(self, config: DdsWireConfig) -> None:
        """Join both domains.

        Raises:
            WireError: the options of the link cannot be understood.
        """
        self._link = EmulatedLink(config.link.schedule(), config.seed)
        self._delayer = Delayer()
        self._contexts = [Context() for _ in config.domains]
        for context, domain in zip(self._contexts, config.domains, strict=True):
            rclpy.init(args=[], context=context, domain_id=domain)
        # Two nodes of one name in one process would share a publisher of log messages, so they have none.
        self._nodes = [rclpy.create_node(NODE_NAME, context=one, enable_rosout=False) for one in self._contexts]
        robot, cloud = self._nodes
        ends: dict[Direction, tuple[Node, Node]] = {"up": (robot, cloud), "down": (cloud, robot)}
        self._unresolved = [Carrier(one, *ends[one.direction], self._link, self._delayer) for one in config.carried]
        # Both directions are resolved on the robot's thread: creating entities is safe from any one thread.
        self._threads: list[threading.Thread] = []
        self._timer = robot.create_timer(RESOLVE_S, self._resolve)

    def _resolve(self) -> None:
        self._unresolved = [carrier for carrier in self._unresolved if not carrier.resolve()]

    def start(self, start_s: float) -> None:
        """Start the schedule's clock, at a steady time."""
        self._delayer.at(steady_s(), lambda: self._link.start(start_s))

    def spin(self) -> None:
        """Carry messages, in threads of its own, until `close`."""
        ends = zip(self._nodes, self._contexts, strict=True)
        self._threads = [threading.Thread(target=_spin, args=end, daemon=True) for end in ends]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Leave both domains, so that the middleware cleans up."""
        self._delayer.close()
        for context in self._contexts:
            context.shutdown()
        for thread in self._threads:
            thread.join(CLOSE_S)
        for node in self._nodes:
            node.destroy_node()


def _spin(node: Node, context: Context) -> None:
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        executor.spin()
    except ExternalShutdownException:
        return


def _message_class(name: str) -> Any:
    package, _, short = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), short)


def main(arguments: Sequence[str]) -> int:
    """Run until standard input ends or SIGTERM."""
    [path] = arguments
    wire = DdsWire(DdsWireConfig.from_json(Path(path).read_text(encoding="utf-8")))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    wire.spin()
    try:
        for line in sys.stdin:
            wire.start(float(json.loads(line)["start"]))
    finally:
        wire.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
