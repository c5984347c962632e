"""Reads the parameters of this side's duplicated nodes, for the comparison with their replicas."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node

from robot_offload_agent.settings.parameters import Configuration, listed
from robot_offload_core.control.nodes import replica_parameters
from robot_offload_core.control.nodes.replica_parameters import Compared, Statement, Table
from robot_offload_core.fence.token import Site

FIELDS = {
    ParameterType.PARAMETER_NOT_SET: None,
    ParameterType.PARAMETER_BOOL: "bool_value",
    ParameterType.PARAMETER_INTEGER: "integer_value",
    ParameterType.PARAMETER_DOUBLE: "double_value",
    ParameterType.PARAMETER_STRING: "string_value",
    ParameterType.PARAMETER_BYTE_ARRAY: "byte_array_value",
    ParameterType.PARAMETER_BOOL_ARRAY: "bool_array_value",
    ParameterType.PARAMETER_INTEGER_ARRAY: "integer_array_value",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "double_array_value",
    ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
}
MAX_READ = 4096
"""Parameters of one node that are read; the largest nodes of Nav2 have some 200."""


class ReplicaParameters:
    """Service clients of the duplicated nodes here. Called on the deciding thread, answered on ROS's.

    Attributes:
        compared: state of the comparison.
    """

    def __init__(
        self, configuration: Configuration, node: Node, names: dict[str, str],
        post: Callable[[Callable[[float], None]], None],
    ) -> None:  # fmt: skip
        """`names` holds the full ROS name of each duplicated node; `post` hands work to the deciding thread."""
        self.side: Site = configuration.side
        self.post = post
        self.may_differ = {spec.name: tuple(listed(spec["may_differ"])) for spec in configuration.nodes}
        self.compared = Compared()
        self.node = node
        self.due_s = dict.fromkeys(names, 0.0)
        self.pending: dict[Any, Any] = {}  # client -> its newest call
        self.list = {
            name: node.create_client(ListParameters, f"{full}/list_parameters") for name, full in names.items()
        }
        self.get = {name: node.create_client(GetParameters, f"{full}/get_parameters") for name, full in names.items()}

    def hear(self, stated: dict[str, Statement]) -> None:
        """Take the other side's statements."""
        self.compared = replica_parameters.heard(self.compared, stated)

    def look(self, now: float) -> None:
        """Begin to read the nodes that are due."""
        for name, due_s in self.due_s.items():
            if now < due_s:
                continue
            hasty = replica_parameters.unlike(self.compared, name)
            period_s = replica_parameters.HASTY_PERIOD_S if hasty else replica_parameters.READ_PERIOD_S
            self.due_s[name] = now + period_s
            if self.list[name].service_is_ready() and self.get[name].service_is_ready():
                self._call(self.list[name], ListParameters.Request(), partial(self._listed, name))
            else:
                self.due_s[name] = now + replica_parameters.HASTY_PERIOD_S
                self._take(name, None)

    def _listed(self, name: str, response: Any) -> None:
        """Ask for the values of all parameters that count (ROS thread)."""
        found = sorted(n for n in response.result.names if replica_parameters.counts(n, self.may_differ[name]))
        names = found[:MAX_READ]
        self._call(self.get[name], GetParameters.Request(names=names), partial(self._got, name, names))

    def _got(self, name: str, names: list[str], response: Any) -> None:
        """Keep the digests of the values (ROS thread)."""
        if len(response.values) != len(names):
            return  # one was undeclared meanwhile; the next reading finds what there is
        table = {
            key: replica_parameters.value_digest(_value(value), self.side)
            for key, value in zip(names, response.values, strict=True)
        }
        self.post(lambda _now: self._take(name, table))

    def _take(self, name: str, table: Table | None) -> None:
        self.compared = replica_parameters.read(self.compared, name, table)

    def _call(self, client: Any, request: Any, done: Callable[[Any], None]) -> None:
        """Call, and forget the call before: rclpy keeps an unanswered one for ever."""
        before = self.pending.get(client)
        if before is not None:
            client.remove_pending_request(before)
        future = self.pending[client] = client.call_async(request)
        future.add_done_callback(lambda answered: done(answered.result()) if answered.result() is not None else None)


def _value(value: ParameterValue) -> object:
    """Return type and value in a form whose text is the same on both sides."""
    field = FIELDS.get(value.type)
    held = None if field is None else getattr(value, field)
    if held is not None and value.type >= ParameterType.PARAMETER_BYTE_ARRAY:
        held = [bytes(it) if isinstance(it, bytes) else it for it in list(held)]
    return value.type, held
