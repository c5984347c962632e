"""Results of goals for a recording: no topic has them, so each goal that has ended is asked for its result, once.

The relay of the robot answers for the declared actions, from what it keeps. The recording then has what service
introspection has: an event of `ACTION/_action/get_result`, with the goal's id, its status and its result. Before ROS 2
Iron there is no type for that, and recordings have no results.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from robot_offload_agent.ros.interfaces import action_types
from robot_offload_agent.ros.native import NativeError
from robot_offload_agent.ros.raw_services import RawClient
from robot_offload_agent.runtime.clock import now_s, wall_ns
from robot_offload_agent.settings.parameters import Named
from robot_offload_core.relay.goals.ports import GoalStatus

ENDED = (GoalStatus.SUCCEEDED, GoalStatus.CANCELED, GoalStatus.ABORTED)
KNOWN = 256
"""Goals of one action that are remembered as asked; a server keeps fewer."""
WAITING = 16
"""Questions of one action that may be open."""
PATIENCE_S = 5.0
EVENT = "_GetResult_Event"
RECEIVED = 3
"""service_msgs/msg/ServiceEventInfo.RESPONSE_RECEIVED."""

Take = Callable[[str, str, bool, bytes], None]


class Results:
    """The results of the goals of one action, on the thread that spins.

    Args:
        node: sends the requests.
        action: its parameters.
        take: called as `topics.Heard` calls it.
    """

    def __init__(self, node: Node, action: Named, take: Take) -> None:
        kinds = action_types(action["type"])
        self._take = take
        self._states = kinds.status
        self._event: Any = getattr(kinds.get_result, "Event", None)
        self._response = kinds.get_result.Response
        self._request = kinds.get_result.Request
        self._client = RawClient(node, kinds.get_result, f"{action['name']}/_action/get_result")
        self._topic, self._type = f"{self._client.name}/_service_event", f"{action['type']}{EVENT}"
        self._known: deque[bytes] | None = None  # None: what has ended before we listened is not asked for
        self._asked: dict[int, float] = {}

    def heard(self, data: bytes) -> None:
        """Take the states of all goals, and ask those that have ended for their results."""
        goals = deserialize_message(data, self._states).status_list
        ended = [bytes(goal.goal_info.goal_id.uuid) for goal in goals if goal.status in ENDED]
        if self._known is None or self._event is None:
            self._known = deque(ended, KNOWN)
            return
        for goal_id in ended:
            if goal_id not in self._known and len(self._asked) < WAITING and self._client.is_ready():
                self._known.append(goal_id)
                self._ask(goal_id)

    def look(self) -> None:
        """Take the answers that have arrived; call this repeatedly."""
        self._client.serve()
        for sequence in [number for number, at_s in self._asked.items() if now_s() - at_s > PATIENCE_S]:
            self._client.forget(sequence)
            del self._asked[sequence]

    def _ask(self, goal_id: bytes) -> None:
        number = 0

        def answered(response: bytes) -> None:
            self._asked.pop(number, None)
            self._take(self._topic, self._type, False, self._written(goal_id, response))

        try:
            number = self._client.ask(bytes(serialize_message(self._of(goal_id))), answered)
        except NativeError:
            return  # nobody is there any more: this result is missing
        self._asked[number] = now_s()

    def _written(self, goal_id: bytes, response: bytes) -> bytes:
        """Return the event that service introspection would have published."""
        event = self._event()
        event.info.event_type = RECEIVED
        event.info.stamp.sec, event.info.stamp.nanosec = divmod(wall_ns(), 1_000_000_000)
        event.request, event.response = [self._of(goal_id)], [deserialize_message(response, self._response)]
        return bytes(serialize_message(event))

    def _of(self, goal_id: bytes) -> Any:
        request = self._request()
        request.goal_id.uuid = list(goal_id)
        return request


def of(node: Node, actions: Iterable[Named], take: Take) -> dict[str, Results]:
    """Return the `Results` of each action, by the topic of its goals' states."""
    return {f"{action['name']}/_action/status": Results(node, action, take) for action in actions}
