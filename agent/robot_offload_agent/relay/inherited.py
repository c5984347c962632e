"""Answers calls that a predecessor of this process took and whose clients still wait.

rmw_fastrtps drops an answer if its request id names a client from which this process has received no request: the id
holds the client's *reader* of answers. With the client's *writer* of requests in its place the answer is sent, and the
client takes it. Reader and writer belong to one participant and are made one after the other, so their entity keys
differ by one. The writer is looked up in the graph, because nothing reaches the client before discovery has found it.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

from rclpy.node import Node
from std_srvs.srv import Trigger

from robot_offload_agent.ros.native import NativeError
from robot_offload_agent.ros.raw_services import Loop, RawClient, RawService
from robot_offload_agent.runtime.clock import now_s

log = logging.getLogger(__name__)

GID_BYTES = 16
PREFIX_BYTES = 12
"""Prefix of a participant in each of its gids."""
KEY = slice(12, 15)
"""The entity's number in its participant."""
PATIENCE_S = 15.0
"""A client that discovery has not found by then is gone."""
ANSWER_TIMES_S = (0.0, 0.5)
"""An answer may leave before the client's reader is matched, so it is sent twice: clients ignore the second one."""
CLIENT_LOOK_S = 0.05
"""Interval at which a client is looked for."""


@dataclass
class _Waiting:
    service: RawService
    caller: bytes
    response: bytes
    end_s: float
    due_s: float = 0.0
    sent: int = 0


class Inherited:
    """Answers to callers whose requests this process never received.

    Attributes:
        waiting: answers that have not been sent as often as planned.
        lost: answers whose clients were not found.
        possible: whether the middleware supports this; None while it is not known.
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        self.waiting: list[_Waiting] = []
        self.lost = 0
        self.possible: bool | None = True

    def answer(self, service: RawService, caller: bytes, response: bytes) -> None:
        """Answer as soon as the client's writer is seen."""
        self.waiting.append(_Waiting(service, caller, response, now_s() + PATIENCE_S))

    def turn(self) -> float:
        """Send what can be sent; return the latest time of the next call, on the steady clock."""
        now = now_s()
        if self.possible is None:
            return now + CLIENT_LOOK_S if self.waiting else float("inf")
        if not self.possible:
            self.lost += len(self.waiting)
            self.waiting.clear()
        for waiting in [w for w in self.waiting if w.due_s <= now]:
            writer = find_writer(self.node, waiting.service.name, waiting.caller)
            if writer is not None:
                self._send(waiting, writer, now)
            elif waiting.sent or now > waiting.end_s:  # the client has ended, or was never found
                self.lost += not waiting.sent
                self.waiting.remove(waiting)
            else:
                waiting.due_s = now + CLIENT_LOOK_S
        return min((w.due_s for w in self.waiting), default=float("inf"))

    def _send(self, waiting: _Waiting, writer: bytes, now: float) -> None:
        try:
            waiting.service.answer(writer + waiting.caller[GID_BYTES:], waiting.response)
        except NativeError as error:
            log.warning("A call of %s that was open before the restart could not be answered: %s", waiting.service.name,
                        error)  # fmt: skip
        waiting.sent += 1
        if waiting.sent == len(ANSWER_TIMES_S):
            self.waiting.remove(waiting)
        else:
            waiting.due_s = now + ANSWER_TIMES_S[waiting.sent] - ANSWER_TIMES_S[waiting.sent - 1]


def find_writer(node: Node, service: str, caller: bytes) -> bytes | None:
    """Return the gid of the writer of requests of a caller's client; None while the graph does not show it."""
    readers = node.get_subscriptions_info_by_topic(f"rr{service}Reply", no_mangle=True)
    if not any(bytes(info.endpoint_gid)[:GID_BYTES] == caller[:GID_BYTES] for info in readers):
        return None  # its reader of answers has not been found, or has gone
    infos = node.get_publishers_info_by_topic(f"rq{service}Request", no_mangle=True)
    for gid in (bytes(info.endpoint_gid)[:GID_BYTES] for info in infos):
        if gid[:PREFIX_BYTES] == caller[:PREFIX_BYTES] and _key(gid) == _key(caller) + 1:
            return gid
    return None


def _key(gid: bytes) -> int:
    return int.from_bytes(gid[KEY], "big")


class SelfTest:
    """Test whether an answer by the writer's gid arrives, with a call to itself that is answered so. Ends by itself.

    Attributes:
        passed: None while it is not known.
        closed: the test has ended and is gone from the graph.
    """

    PATIENCE_S = 5.0
    STEP_S = 0.02

    def __init__(self, node: Node, loop: Loop, name: str) -> None:
        self.node, self.loop = node, loop
        self.service = RawService(node, Trigger, name, self._take)
        self.client = RawClient(node, Trigger, name)
        loop.services.append(self.service)
        loop.clients.append(self.client)
        self.passed: bool | None = None
        self.closed = False
        self.end_s = now_s() + self.PATIENCE_S
        self.asked = False
        self.caller: bytes | None = None

    def turn(self) -> float:
        """Do the next step; return when to call again, on the steady clock: never after the end."""
        now = now_s()
        if self.passed is not None or now > self.end_s:
            self.passed = bool(self.passed)
            self._close()
            return float("inf")
        if not self.asked:
            if self.client.is_ready():
                self.asked = True
                self.client.ask(self.client.request.empty(), self._answered)
        elif self.caller is not None:
            writer = find_writer(self.node, self.service.name, self.caller)
            if writer is not None:
                self.service.answer(writer + self.caller[GID_BYTES:], self.service.response.empty())
                self.caller = None
        return now + self.STEP_S

    def _take(self, caller: bytes, _request: bytes) -> None:
        self.caller = caller

    def _answered(self, _response: bytes) -> None:
        self.passed = True

    def _close(self) -> None:
        self.closed = True
        self.loop.services.remove(self.service)
        self.loop.clients.remove(self.client)
        self.node.destroy_service(self.service.entity)
        self.node.destroy_client(self.client.entity)
