"""What the relay serves and calls: services, and actions as the three services and two topics that they are."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from robot_offload_agent.relay import cdr
from robot_offload_agent.relay.inherited import Inherited
from robot_offload_agent.ros.interfaces import action_types, service_type
from robot_offload_agent.ros.native import NativeError
from robot_offload_agent.ros.raw_services import Loop, RawClient, RawService
from robot_offload_core.ledger.ports import Face, GoalEntry, GoalStatus
from robot_offload_core.ledger.wire_ids import goal_id_of
from robot_offload_core.process.relay import RelayProcess

FEEDBACK_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATUS_QOS = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)  # fmt: skip
SEND, CANCEL, RESULT = "send_goal", "cancel_goal", "get_result"
MOST_OPEN = 4096
"""Callers of one service that are waiting at once; of more the oldest counts as gone."""
Later = Callable[[Callable[[], None]], None]
"""Calls a function after the present call into the relay has returned."""


class Server:
    """One service served by hand: its open callers, and how each is answered."""

    def __init__(
        self,
        node: Node,
        loop: Loop,
        inherited: Inherited,
        raw: tuple[object, str],
        take: Callable[[bytes, bytes], None],
    ) -> None:
        """`raw` are the service's class and its full name."""
        self.inherited = inherited
        self.take = take
        self.open: dict[bytes, None] = {}
        self.raw = RawService(node, raw[0], raw[1], self._requested)
        loop.services.append(self.raw)

    def _requested(self, caller: bytes, request: bytes) -> None:
        self.open[caller] = None
        if len(self.open) > MOST_OPEN:
            del self.open[next(iter(self.open))]
        self.take(caller, request)

    def answer(self, caller: bytes, response: bytes) -> None:
        """Answers a caller of this process or of its predecessor; raises NativeError."""
        if caller in self.open:
            del self.open[caller]
            self.raw.answer(caller, response)
        else:
            self.inherited.answer(self.raw, caller, response)

    def drop(self, caller: bytes) -> None:
        """Forgets a caller that gets no answer."""
        self.open.pop(caller, None)


class ServiceServer:
    """A service that clients call."""

    def __init__(
        self, node: Node, loop: Loop, inherited: Inherited, process: RelayProcess, face: Face, name: str, full: str,
        type_name: str,
    ) -> None:  # fmt: skip
        self.kind = service_type(type_name)
        self.server = Server(node, loop, inherited, (self.kind, full), partial(process.called, face, name))

    def failure(self, message: str) -> bytes | None:
        """Returns a response that says what failed, None where the response cannot."""
        kind = self.kind.Response
        fields = kind.get_fields_and_field_types()
        if fields.get("success") != "boolean":
            return None
        response = kind()
        if fields.get("message") == "string":
            response.message = message
        return bytes(serialize_message(response))


class ActionServer:
    """An action that clients use."""

    def __init__(
        self, node: Node, loop: Loop, inherited: Inherited, process: RelayProcess, face: Face, name: str, full: str,
        type_name: str,
    ) -> None:  # fmt: skip
        types = action_types(type_name)
        hidden = f"{full}/_action/"
        self.process, self.face, self.name = process, face, name
        make = partial(Server, node, loop, inherited)
        self.send = make((types.send_goal, hidden + SEND), partial(process.goal_requested, face, name))
        self.cancel = make((types.cancel_goal, hidden + CANCEL), self._cancel_requested)
        self.result = make((types.get_result, hidden + RESULT), self._result_requested)
        self.feedback = node.create_publisher(types.feedback, hidden + "feedback", FEEDBACK_QOS)
        self.status = node.create_publisher(types.status, hidden + "status", STATUS_QOS)
        self.default_result = self.result.raw.response.empty()

    def _cancel_requested(self, caller: bytes, request: bytes) -> None:
        self.process.cancel_requested(self.face, self.name, caller, *cdr.read_cancel_request(request))

    def _result_requested(self, caller: bytes, request: bytes) -> None:
        goal_id = goal_id_of(request)
        if goal_id is not None:
            self.process.result_requested(self.face, self.name, caller, goal_id)

    def answer_result(self, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        """Answers a `get_result`; raises NativeError."""
        self.result.answer(caller, payload or cdr.with_status(self.default_result, status))

    def publish_status(self, goals: Sequence[GoalEntry]) -> None:
        """Publishes the status of all goals."""
        self.status.publish(cdr.status_array(goals))


class ServiceClient:
    """A service that the relay calls."""

    def __init__(self, node: Node, loop: Loop, process: RelayProcess, full: str, type_name: str) -> None:
        self.process = process
        self.raw = RawClient(node, service_type(type_name), full)
        self.keys: dict[int, int] = {}
        loop.clients.append(self.raw)

    def call(self, key: int, payload: bytes) -> None:
        """Calls; raises NativeError."""
        self.keys[key] = self.raw.ask(payload, partial(self._answered, key))

    def _answered(self, key: int, response: bytes) -> None:
        self.keys.pop(key, None)
        self.process.call_answered(key, response)

    def forget(self, key: int) -> None:
        """Drops a call."""
        sequence = self.keys.pop(key, None)
        if sequence is not None:
            self.raw.forget(sequence)

    def endpoints(self) -> str:
        """Returns who serves, "" for nobody."""
        return endpoints((self.raw,))


class ActionClient:
    """An action whose server the relay calls."""

    def __init__(
        self, node: Node, loop: Loop, process: RelayProcess, later: Later, face: Face, name: str, full: str,
        type_name: str,
    ) -> None:  # fmt: skip
        types = action_types(type_name)
        hidden = f"{full}/_action/"
        self.process, self.later, self.face, self.name = process, later, face, name
        self.send = RawClient(node, types.send_goal, hidden + SEND)
        self.cancelling = RawClient(node, types.cancel_goal, hidden + CANCEL)
        self.result = RawClient(node, types.get_result, hidden + RESULT)
        loop.clients += [self.send, self.cancelling, self.result]
        arrived = partial(process.feedback_arrived, face, name)
        node.create_subscription(types.feedback, hidden + "feedback", arrived, FEEDBACK_QOS, raw=True)

    def offer(self, payload: bytes) -> None:
        """Sends a goal. One that is no goal of this type counts as refused."""
        goal_id = goal_id_of(payload) or b""

        def answered(response: bytes) -> None:
            self.process.offer_answered(self.face, self.name, goal_id, cdr.is_accepted(response))

        try:
            self.send.ask(payload, answered)
        except NativeError:
            self.later(lambda: self.process.offer_answered(self.face, self.name, goal_id, False))
            raise

    def cancel(self, goal_id: bytes) -> None:
        """Cancels a goal; raises NativeError."""

        def answered(response: bytes) -> None:
            self.process.cancel_answered(self.face, self.name, goal_id, cdr.cancel_code(response))

        self.cancelling.ask(cdr.cancel_request(goal_id), answered)

    def ask_result(self, goal_id: bytes) -> None:
        """Asks for a result; raises NativeError."""

        def answered(response: bytes) -> None:
            self.process.result_arrived(self.face, self.name, goal_id, cdr.result_status(response), response)

        self.result.ask(cdr.result_request(goal_id), answered)

    def endpoints(self) -> str:
        """Returns who serves, "" for nobody."""
        return endpoints((self.send, self.cancelling, self.result))


def endpoints(clients: Sequence[RawClient]) -> str:
    """Returns a text that changes when one of these servers is started again; "" while one of them is missing."""
    if not all(client.is_ready() for client in clients):
        return ""
    found: deque[str] = deque()
    for client in clients:
        infos = client.node.get_subscriptions_info_by_topic(f"rq{client.name}Request", no_mangle=True)
        found.append(",".join(sorted(bytes(info.endpoint_gid).hex() for info in infos)))
    return " ".join(found) if any(found) else "seen"  # not every middleware shows the topics behind a service
