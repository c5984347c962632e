"""Entities that the relay serves and calls: services, and actions as their three services and two topics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.utilities import get_rmw_implementation_identifier

from robot_offload_agent.relay import cdr
from robot_offload_agent.relay.inherited import Inherited
from robot_offload_agent.ros.interfaces import action_types, service_type
from robot_offload_agent.ros.native import NativeError
from robot_offload_agent.ros.raw_services import Loop, RawClient, RawService
from robot_offload_core.relay.goals.ports import Face, GoalEntry, GoalStatus
from robot_offload_core.relay.goals.wire_ids import goal_id_of
from robot_offload_core.relay.process import RelayProcess

FEEDBACK_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATUS_QOS = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)  # fmt: skip
SHOWS_SERVICES = "fastrtps" in get_rmw_implementation_identifier()
"""The graph shows the topics behind a service; not every middleware has any."""
SEND, CANCEL, RESULT = "send_goal", "cancel_goal", "get_result"
MOST_OPEN = 4096
"""Most callers of one service that wait at once; above that the oldest counts as gone."""


class Owner(Protocol):
    """The shell that entities belong to.

    Attributes:
        node, loop: of the process.
        inherited: answers the callers of a predecessor.
    """

    @property
    def process(self) -> RelayProcess:
        """Return the process that takes events; it exists when the loop runs."""

    node: Node
    loop: Loop
    inherited: Inherited

    def later(self, act: Callable[[], None]) -> None:
        """Call a function after the present call into the relay has returned."""


class Server:
    """One service served by hand: its open callers, and how each is answered."""

    def __init__(self, owner: Owner, kind: Any, full: str, take: Callable[[bytes, bytes], None]) -> None:
        self.inherited = owner.inherited
        self.take = take
        self.open: dict[bytes, None] = {}
        self.raw = RawService(owner.node, kind, full, self._requested)
        owner.loop.services.append(self.raw)

    def _requested(self, caller: bytes, request: bytes) -> None:
        self.open[caller] = None
        if len(self.open) > MOST_OPEN:
            del self.open[next(iter(self.open))]
        self.take(caller, request)

    def answer(self, caller: bytes, response: bytes) -> None:
        """Answer a caller of this process or of its predecessor; raise NativeError."""
        if caller in self.open:
            del self.open[caller]
            self.raw.answer(caller, response)
        else:
            self.inherited.answer(self.raw, caller, response)

    def drop(self, caller: bytes) -> None:
        """Forget a caller that gets no answer."""
        self.open.pop(caller, None)


class ServiceServer:
    """A service that clients call."""

    def __init__(self, owner: Owner, face: Face, name: str, full: str, type_name: str) -> None:
        self.owner, self.face, self.name = owner, face, name
        self.kind = service_type(type_name)
        self.server = Server(owner, self.kind, full, self._called)

    def _called(self, caller: bytes, request: bytes) -> None:
        self.owner.process.called(self.face, self.name, caller, request)

    def failure(self, message: str) -> bytes | None:
        """Return a response that states what failed, None if the response cannot."""
        fields = _fields(self.kind)
        if fields.get("success") != "boolean":
            return None
        response = self.kind.Response()
        if fields.get("message") == "string":
            response.message = message
        return bytes(serialize_message(response))


class ActionServer:
    """An action that clients use."""

    def __init__(self, owner: Owner, face: Face, name: str, full: str, type_name: str) -> None:
        types, hidden = action_types(type_name), f"{full}/_action/"
        self.owner, self.face, self.name = owner, face, name
        self.send = Server(owner, types.send_goal, hidden + SEND, self._goal_requested)
        self.cancel = Server(owner, types.cancel_goal, hidden + CANCEL, self._cancel_requested)
        self.result = Server(owner, types.get_result, hidden + RESULT, self._result_requested)
        self.feedback = owner.node.create_publisher(types.feedback, hidden + "feedback", FEEDBACK_QOS)
        self.status = owner.node.create_publisher(types.status, hidden + "status", STATUS_QOS)
        self.default_result = self.result.raw.response.empty()

    def _goal_requested(self, caller: bytes, request: bytes) -> None:
        self.owner.process.goal_requested(self.face, self.name, caller, request)

    def _cancel_requested(self, caller: bytes, request: bytes) -> None:
        self.owner.process.cancel_requested(self.face, self.name, caller, *cdr.read_cancel_request(request))

    def _result_requested(self, caller: bytes, request: bytes) -> None:
        goal_id = goal_id_of(request)
        if goal_id is not None:
            self.owner.process.result_requested(self.face, self.name, caller, goal_id)

    def answer_result(self, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        """Answer a `get_result`; raise NativeError."""
        self.result.answer(caller, payload or cdr.with_status(self.default_result, status))

    def publish_status(self, goals: Sequence[GoalEntry]) -> None:
        """Publish the status of all goals."""
        self.status.publish(cdr.status_array(goals))


class ServiceClient:
    """A service that the relay calls."""

    def __init__(self, owner: Owner, full: str, type_name: str) -> None:
        self.owner = owner
        self.kind = service_type(type_name)
        self.says_success = _fields(self.kind).get("success") == "boolean"
        self.raw = RawClient(owner.node, self.kind, full)
        self.sequences: dict[int, int] = {}
        owner.loop.clients.append(self.raw)

    def call(self, key: int, payload: bytes) -> None:
        """Call; raise NativeError."""
        self.sequences[key] = self.raw.ask(payload, partial(self._answered, key))

    def _answered(self, key: int, response: bytes) -> None:
        self.sequences.pop(key, None)
        success = not self.says_success or deserialize_message(response, self.kind.Response).success
        self.owner.process.call_answered(key, response, success)

    def forget(self, key: int) -> None:
        """Drop a call."""
        sequence = self.sequences.pop(key, None)
        if sequence is not None:
            self.raw.forget(sequence)

    def endpoints(self) -> str:
        """Return a text that identifies the server, "" without one."""
        return endpoints((self.raw,))


class ActionClient:
    """An action whose server the relay calls."""

    def __init__(self, owner: Owner, face: Face, name: str, full: str, type_name: str) -> None:
        types, hidden = action_types(type_name), f"{full}/_action/"
        self.owner, self.face, self.name = owner, face, name
        self.send = RawClient(owner.node, types.send_goal, hidden + SEND)
        self.cancelling = RawClient(owner.node, types.cancel_goal, hidden + CANCEL)
        self.result = RawClient(owner.node, types.get_result, hidden + RESULT)
        owner.loop.clients += [self.send, self.cancelling, self.result]
        owner.node.create_subscription(types.feedback, hidden + "feedback", self._feedback, FEEDBACK_QOS, raw=True)

    def _feedback(self, payload: bytes) -> None:
        self.owner.process.feedback_arrived(self.face, self.name, payload)

    def offer(self, payload: bytes) -> None:
        """Send a goal. Bytes that are not a goal of this type count as refused; raise NativeError for them."""
        goal_id = goal_id_of(payload) or b""

        def answered(accepted: bool) -> None:
            self.owner.process.offer_answered(self.face, self.name, goal_id, accepted)

        try:
            self.send.ask(payload, lambda response: answered(cdr.is_accepted(response)))
        except NativeError:
            self.owner.later(partial(answered, False))
            raise

    def cancel(self, goal_id: bytes) -> None:
        """Cancel a goal; raise NativeError."""

        def answered(response: bytes) -> None:
            self.owner.process.cancel_answered(self.face, self.name, goal_id, cdr.cancel_code(response))

        self.cancelling.ask(cdr.cancel_request(goal_id), answered)

    def ask_result(self, goal_id: bytes) -> None:
        """Ask for a result; raise NativeError."""

        def answered(response: bytes) -> None:
            status = cdr.result_status(response)
            self.owner.process.result_arrived(self.face, self.name, goal_id, status, response)

        self.result.ask(cdr.result_request(goal_id), answered)

    def endpoints(self) -> str:
        """Return a text that identifies the server, "" without one."""
        return endpoints((self.send, self.cancelling, self.result))


def endpoints(clients: Sequence[RawClient]) -> str:
    """Return a text that changes when one of these servers is restarted; "" while one of them is missing."""
    if not all(client.is_ready() for client in clients):
        return ""
    found: list[str] = []
    for client in clients:
        infos = client.node.get_subscriptions_info_by_topic(f"rq{client.name}Request", no_mangle=True)
        found.append(",".join(sorted(bytes(info.endpoint_gid).hex() for info in infos)))
    if not any(found) and not SHOWS_SERVICES:
        return "seen"
    return " ".join(found) if all(found) else ""  # what the graph shows is not complete yet


def _fields(kind: Any) -> dict[str, str]:
    """Return the fields of a service's response and their types."""
    return dict(kind.Response.get_fields_and_field_types())
