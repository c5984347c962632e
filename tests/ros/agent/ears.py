"""The test's own ROS node in one domain: hears, feeds, calls services; it plays consumer and driver."""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from robot_offload_agent.runtime.clock import now_s, wall_us
from robot_offload_lab.judge import translate
from robot_offload_lab.judge.recording import Arrival, PlacementChange

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
KEPT = 1000
"""Messages that a subscription of the test keeps until its thread gets its turn on a busy machine."""
CALL_S = 60.0
ASK_AGAIN_S = 1.5
INHIBIT = "/driver/inhibit"
DEAD_MAN_S = 0.5
"""Without a command for this long the driver stops by itself."""


def wait_until(condition: Callable[[], Any], patience_s: float) -> bool:
    """Polls a condition; says whether it came to hold. One on words that nobody has told yet (KeyError) does not."""
    end_s = time.monotonic() + patience_s
    while time.monotonic() <= end_s:
        with contextlib.suppress(KeyError):
            if condition():
                return True
        time.sleep(0.01)
    return False


@dataclass(frozen=True)
class Status:
    """One entry of /diagnostics."""

    t_s: float
    level: int
    message: str
    values: dict[str, str]


class Ear:
    """A node that is spun by a thread of its own."""

    def __init__(self, domain: int, name: str) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node(name, context=self.context, enable_rosout=False, start_parameter_services=False)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.diagnostics: dict[str, Status] = {}
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 10)
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._spin, name=name, daemon=True)
        self.thread.start()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self.ended.is_set():
                self.executor.spin_once()

    def close(self) -> None:
        """Ends the thread at its next turn, then what it works with: others may still publish."""
        self.executor.create_task(self.ended.set)
        self.thread.join(CALL_S)
        self.executor.shutdown()
        self.node.destroy_node()  # a participant lives as long as its node
        rclpy.shutdown(context=self.context)

    def _diagnosed(self, array: DiagnosticArray) -> None:
        for status in array.status:
            values = {pair.key: pair.value for pair in status.values}
            level = int.from_bytes(status.level, "big")
            self.diagnostics[status.name.partition(": ")[2]] = Status(now_s(), level, status.message, values)

    # -- listening and feeding ----------------------------------------------------------------------------------------

    def hear(self, message_type: Any, topic: str, qos: Any = KEPT) -> list[tuple[float, Any]]:
        """(arrival, message) of everything from now on."""
        heard: list[tuple[float, Any]] = []
        self.node.create_subscription(message_type, topic, lambda m: heard.append((now_s(), m)), qos)
        return heard

    def arrivals(self, topic: str) -> list[Arrival]:
        """What a consumer of the tests' output gets."""
        heard: list[Arrival] = []

        def take(message: Header, info: dict[str, int]) -> None:
            producer, _, sequence = message.frame_id.partition("#")
            passed_s = info["source_timestamp"] / 1e9
            t_s = said_s(info)
            sent_s = t_s - (passed_s - stamp_s(message))
            heard.append(Arrival(topic, t_s, producer, int(sequence), sent_s, translate.site_of(producer)))

        self.node.create_subscription(Header, topic, take, KEPT)
        return heard

    def placements(self) -> list[PlacementChange]:
        """Every /offload/placement."""
        heard: list[PlacementChange] = []

        def take(message: String, info: dict[str, int]) -> None:
            change = translate.placement(said_s(info), message.data)
            assert change is not None, message.data
            heard.append(change)

        self.node.create_subscription(String, "/offload/placement", take, LATCHED)
        return heard

    def inhibit_orders(self, service: str) -> list[tuple[float, bool]]:
        """Serves the driver's inhibit service; the list grows with every order."""
        orders: list[tuple[float, bool]] = []

        def obey(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            orders.append((now_s(), request.data))
            response.success = True
            return response

        self.node.create_service(SetBool, service, obey)
        return orders

    def feed(self, topic: str, rate_hz: float) -> Any:
        """Publishes a stamped Header at a rate; `cancel()` and `reset()` of what is returned stop and go on."""
        publisher = self.node.create_publisher(Header, topic, 10)
        numbers = iter(range(1, 1 << 31))

        def tell() -> None:
            publisher.publish(Header(stamp=self.node.get_clock().now().to_msg(), frame_id=f"feed#{next(numbers)}"))

        return self.node.create_timer(1.0 / rate_hz, tell)

    def say(self, topic: str, frame_id: str, patience_s: float = CALL_S) -> None:
        """Publishes one Header, as soon as somebody hears it."""
        publisher = self.node.create_publisher(Header, topic, 10)
        assert wait_until(publisher.get_subscription_count, patience_s), f"nobody hears {topic}"
        publisher.publish(Header(frame_id=frame_id))

    def latch(self, topic: str, text: str) -> Any:
        """Publishes a latched String."""
        publisher = self.node.create_publisher(String, topic, LATCHED)
        publisher.publish(String(data=text))
        return publisher

    # -- calling ------------------------------------------------------------------------------------------------------

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Calls a service. Asks again, because a call is lost while a server that was killed is still in the graph."""
        client = self.node.create_client(service_type, name)
        answers: list[Any] = []

        def answered() -> bool:
            return any(future.done() for future in answers)

        try:
            for _ in range(round(CALL_S / ASK_AGAIN_S)):
                if wait_until(client.service_is_ready, ASK_AGAIN_S):
                    answers.append(client.call_async(request))
                    if wait_until(answered, ASK_AGAIN_S):
                        return next(future.result() for future in answers if future.done())
            raise AssertionError(f"no answer of {name}")
        finally:
            self.executor.create_task(self.node.destroy_client, client)

    def trigger(self, name: str) -> Any:
        return self.call(Trigger, name, Trigger.Request())

    def get_parameter(self, node: str, name: str) -> Any:
        """The value of a text parameter."""
        answer = self.call(GetParameters, f"{node}/get_parameters", GetParameters.Request(names=[name]))
        return answer.values[0].string_value

    def set_parameter(self, node: str, name: str, value: str | float | bool) -> Any:
        """Sets one parameter; returns the SetParametersResult."""
        if isinstance(value, bool):
            typed = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=value)
        elif isinstance(value, float):
            typed = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        else:
            typed = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=typed)])
        return self.call(SetParameters, f"{node}/set_parameters", request).results[0]


@dataclass(frozen=True)
class Driver:
    """The robot's driver as the tests see it: what it was told, and its dead man for the time when no command comes.

    Attributes:
        arrivals: the commands.
        orders: (moment, inhibit or release) of the inhibit service.
    """

    arrivals: list[Arrival]
    orders: list[tuple[float, bool]]

    @property
    def inhibited(self) -> bool:
        return bool(self.orders) and self.orders[-1][1]

    def drives(self) -> bool:
        """It is not inhibited and its last command is young."""
        return not self.inhibited and bool(self.arrivals) and now_s() - self.arrivals[-1].t_s < DEAD_MAN_S


def said_s(info: dict[str, int]) -> float:
    """When a message was published, on our steady clock: publisher and test share one host."""
    return info["source_timestamp"] / 1e9 - wall_us() / 1e6


def stamp_s(message: Any) -> float:
    return float(message.stamp.sec + message.stamp.nanosec / 1e9)
