"""The parameters of state: reads those of the nodes here while this side holds, otherwise sets the holder's here.

A thread of its own waits for the nodes' parameter services, so that no topic waits for them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.qos import qos_profile_parameter_events

from robot_offload_agent.ros import context
from robot_offload_agent.ros.managed_nodes import full_name
from robot_offload_agent.ros.replica_parameters import FIELDS
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.parameters import Configuration, listed
from robot_offload_core.control.nodes.replica_parameters import counts
from robot_offload_core.data import parameter_values
from robot_offload_core.data.parameter_values import MAX_PARAMETERS, Table, Type, Value
from robot_offload_core.data.states import StateProcess
from robot_offload_core.words.declared import ParameterState

HOLDER_READ_S = 2.0
"""Interval at which the holder's parameters are read; a change is announced by its node and read at once."""
STANDBY_READ_S = 5.0
"""Interval at which a standby's are compared again: another program may have set them there."""
HASTY_S = 0.2
"""The same while a node does not answer."""
CALL_S = 1.0
"""A node without an answer for this long counts as not answering."""


@dataclass(frozen=True)
class _Done:
    """The result of a wish, which is checked again from `due_s` on."""

    wish: tuple[bytes, bool]
    refused: str
    due_s: float


class _Services:
    """Parameter services of one node. Calls wait for their answers."""

    def __init__(self, node: Any, full: str) -> None:
        self._list = node.create_client(ListParameters, f"{full}/list_parameters")
        self._get = node.create_client(GetParameters, f"{full}/get_parameters")
        self._set = node.create_client(SetParameters, f"{full}/set_parameters")

    def read(self, wanted: Callable[[str], bool]) -> dict[str, Value] | None:
        """Return the requested parameters; None if the node does not answer."""
        answer = _call(self._list, ListParameters.Request())
        if answer is None:
            return None
        names = sorted(filter(wanted, answer.result.names))[:MAX_PARAMETERS]
        answer = _call(self._get, GetParameters.Request(names=names))
        if answer is None or len(answer.values) != len(names):
            return None  # one was undeclared meanwhile
        return {name: _taken(value) for name, value in zip(names, answer.values, strict=True) if value.type}

    def set(self, table: Table) -> dict[str, str] | None:
        """Set parameters one by one; return the reasons of those that were refused, None without an answer."""
        wanted = [Parameter(name=name, value=_given(*value)) for name, value in table.items()]
        answer = _call(self._set, SetParameters.Request(parameters=wanted))
        if answer is None:
            return None
        results = zip(table, answer.results, strict=False)
        return {name: result.reason or "refused" for name, result in results if not result.successful}


class ParameterCopies:
    """The nodes named in all entries of state; its threads begin at once."""

    def __init__(self, configuration: Configuration, states: dict[str, ParameterState], process: StateProcess) -> None:
        self.side, self.states, self.process = configuration.side, states, process
        self.may_differ = {spec.name: tuple(listed(spec["may_differ"])) for spec in configuration.nodes}
        self.node = context.make_node(configuration, f"offload_parameters_{configuration['side']}")
        named = {node: full_name(configuration, node) for state in states.values() for node in _nodes(state)}
        self.services = {node: _Services(self.node, full) for node, full in named.items()}
        self.watched = set(named.values())
        self.node.create_subscription(ParameterEvent, "/parameter_events", self._on_event, qos_profile_parameter_events)
        self.lock, self.wake = threading.Lock(), threading.Event()
        self.wishes: dict[str, tuple[bytes, bool]] = {}
        self.done: dict[str, _Done] = {}
        self.ours: dict[tuple[str, str], set[str]] = {}  # (entry, node) -> names that were set here
        threading.Thread(target=partial(context.spin, self.node), name="parameters", daemon=True).start()
        threading.Thread(target=self._work, name="copies", daemon=True).start()

    def wish(self, name: str, payload: bytes, active: bool) -> str | None:
        """Set what is due, given whether the declaring node is Active; return what was refused, None: not yet."""
        with self.lock:
            if self.wishes.get(name) != (payload, active):
                self.wishes[name] = payload, active
                self.wake.set()
            done = self.done.get(name)
            return done.refused if done is not None and done.wish == (payload, active) else None

    def _on_event(self, event: Any) -> None:
        if event.node in self.watched:
            self.wake.set()

    def _work(self) -> None:
        """Read or set what is due, repeatedly (a thread of its own)."""
        wait_s = HOLDER_READ_S
        while context.is_up():
            self.wake.wait(wait_s)
            self.wake.clear()
            silent = [name for name in self.states if not self._attend(name)]
            wait_s = HASTY_S if silent else HOLDER_READ_S

    def _attend(self, name: str) -> bool:
        """Set or read what is due of an entry; return whether all nodes that were asked to take a value answered."""
        with self.lock:
            wish, done = self.wishes.get(name), self.done.get(name)
        stay = self.process.stay()
        new = wish is not None and (done is None or done.wish != wish)
        if wish is not None and (new or (stay is None and done is not None and now_s() >= done.due_s)):
            refused = self._set(name, wish[0], again=new and wish[1])
            if refused is None:
                return False
            with self.lock:
                self.done[name] = _Done(wish, refused, now_s() + STANDBY_READ_S)
        elif stay is not None:
            self._forget(name, wish)
            tables = {node: self._read(name, node) for node in _nodes(self.states[name])}
            found = {node: table for node, table in tables.items() if table is not None}
            if found and self.process.stay() == stay:
                self.process.published(name, parameter_values.encode(found))
        return True

    def _forget(self, name: str, wish: tuple[bytes, bool] | None) -> None:
        """Drop a wish that was met: from now on the values here are the newest."""
        with self.lock:
            if self.wishes.get(name) == wish:
                self.wishes.pop(name, None)

    def _read(self, name: str, node: str) -> dict[str, Value] | None:
        return self.services[node].read(partial(self._counts, name, node))

    def _set(self, name: str, payload: bytes, *, again: bool) -> str | None:
        """Set what differs; return what was refused, None if a node does not answer.

        With `again` set equal values that were set before, too: a node that has just become Active may not have got
        them.
        """
        refused: list[str] = []
        for node, wanted in (parameter_values.decode(payload) or {}).items():
            if node not in _nodes(self.states[name]):
                continue
            table = {n: v for n, v in parameter_values.here(wanted, self.side).items() if self._counts(name, node, n)}
            own = self.services[node].read(table.__contains__)
            if own is None:
                return None
            ours = self.ours.setdefault((name, node), set())
            unlike = parameter_values.unlike(table, own)
            ours.update(unlike)
            due = {n: v for n, v in table.items() if n in unlike or (again and n in ours and n in own)}
            answers = self.services[node].set(due) if due else {}
            if answers is None:
                return None
            self.process.data.counters[f"state {name}.parameters_set"] += len(due) - len(answers)
            answers |= dict.fromkeys(parameter_values.absent(table, own), "not declared")
            refused += [f"{node}.{parameter} ({why})" for parameter, why in sorted(answers.items())]
        return parameter_values.sentence(refused)

    def _counts(self, name: str, node: str, parameter: str) -> bool:
        return counts(parameter, (*self.states[name].except_, *self.may_differ.get(node, ())))


def _nodes(state: ParameterState) -> Iterable[str]:
    return state.nodes or (state.node,)


def _call(client: Any, request: Any) -> Any:
    """Return the answer; None if there is none in time."""
    if not client.service_is_ready():
        return None
    answered = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: answered.set())
    if not answered.wait(CALL_S):
        client.remove_pending_request(future)  # rclpy keeps one without an answer for ever
        return None
    return future.result()


def _taken(value: ParameterValue) -> Value:
    """Return a parameter's value in the form that is carried."""
    held = getattr(value, _field(value.type))
    if value.type == Type.BYTE_ARRAY:
        held = [it[0] if isinstance(it, bytes) else it for it in held]
    return value.type, list(held) if value.type > Type.STRING else held


def _field(kind: int) -> str:
    field = FIELDS[kind]
    assert field is not None
    return field


def _given(kind: int, held: Any) -> ParameterValue:
    """Return a carried value in the form of ROS."""
    if kind == Type.BYTE_ARRAY:
        held = [bytes([it]) for it in held]
    return ParameterValue(type=kind, **{_field(kind): held})
