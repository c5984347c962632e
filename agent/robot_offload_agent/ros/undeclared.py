"""Undeclared topics, services and calls of the group's nodes, each with the line to add."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from robot_offload_agent.settings.parameters import Configuration
from robot_offload_agent.settings.served import private_name

OWN_TOPICS = ("/rosout", "/parameter_events")
_HIDDEN = "/_action/"
_GOALS = "/_action/send_goal"
_GOAL_TYPE = "_SendGoal"
Named = tuple[tuple[str, str], ...]
"""Names with their types, sorted."""


@dataclass(frozen=True)
class Undeclared:
    """Warnings about one duplicated node; empty if there are none.

    Attributes:
        publishes: topics that consumers would hear from both sides.
        serves: services and actions that only this side's replica answers.
        calls: services and actions outside the group.
    """

    publishes: str = ""
    serves: str = ""
    calls: str = ""

    def __iter__(self) -> Iterator[str]:
        """Yield the warnings that there are."""
        return filter(None, (self.publishes, self.serves, self.calls))


class Declared:
    """Compares what the graph shows of the group's nodes with the declarations of one side."""

    def __init__(self, configuration: Configuration, node: Any) -> None:
        self._configuration = configuration
        self._node = node
        side = configuration.side.value
        own = (configuration.actions, configuration.used_actions)
        self._actions = {private_name(side, action["name"]) for group in own for action in group}
        calls = (configuration.services, configuration.used_services)
        self._services = {private_name(side, service["name"]) for group in calls for service in group}
        self._topics = {output[f"{side}_topic"] for output in configuration.outputs} | set(OWN_TOPICS)

    def compare(self, names: Mapping[str, str]) -> dict[str, Undeclared]:
        """Return the warnings for each duplicated node that is seen.

        Args:
            names: full ROS name of each duplicated node, by its declared one.
        """
        served = {full: self._asked("service", full) for full in names.values()}
        inside = {name for services in served.values() for name, _ in services or ()}
        found = {}
        for name, full in names.items():
            topics, services, calls = self._asked("publisher", full), served[full], self._asked("client", full)
            if topics is None or services is None or calls is None:
                continue  # not in the graph (yet)
            found[name] = Undeclared(
                self._publishes(name, self._strange(topics, full)),
                self._serves(name, self._strange(services, full)),
                self._calls(name, [it for it in self._strange(calls, full) if it[0] not in inside]),
            )
        return found

    def _asked(self, kind: str, full: str) -> Named | None:
        """Return a node's names of a kind; None if the node is not in the graph."""
        namespace, _, short = full.rpartition("/")
        try:
            found = getattr(self._node, f"get_{kind}_names_and_types_by_node")(short, namespace or "/")
        except RuntimeError:  # rclpy raises this for a node that is not in the graph (yet)
            return None
        return tuple(sorted((name, types[0]) for name, types in found))

    def _strange(self, named: Iterable[tuple[str, str]], full: str) -> list[tuple[str, str]]:
        """Return names that are neither declared, nor silent, nor the node's own."""
        known = self._topics | self._services
        return [
            (name, type_name)
            for name, type_name in named
            if name not in known
            and name.partition(_HIDDEN)[0] not in self._actions
            and not name.startswith(f"{full}/")
            and not self._configuration.silent(name.partition(_HIDDEN)[0])
        ]

    @staticmethod
    def _publishes(node: str, extra: list[tuple[str, str]]) -> str:
        extra = [(topic, type_name) for topic, type_name in extra if _HIDDEN not in topic]
        if not extra:
            return ""
        lines = ", ".join(f"{{topic: {topic}, type: {type_name}}}" for topic, type_name in extra)
        return (
            f"Duplicated node {node} publishes {_listed(extra)}, which no output declares: both replicas would be "
            f"heard; declare it under outputs or remap it. Add to the node: outputs: [{lines}]"
        )

    @staticmethod
    def _serves(node: str, extra: list[tuple[str, str]]) -> str:
        actions, services = _split(extra)
        if not actions and not services:
            return ""
        lines = _lines(actions, services, ", onSwitch: Abort")
        return (
            f"Duplicated node {node} serves {_listed([*actions, *services])}, which is not declared: only the replica "
            f"of this side answers, and refuses while the other side acts. Add to the node: {lines}; or list it under "
            "switching.silent"
        )

    @staticmethod
    def _calls(node: str, extra: list[tuple[str, str]]) -> str:
        actions, services = _split(extra)
        if not actions and not services:
            return ""
        return (
            f"Duplicated node {node} calls {_listed([*actions, *services])} outside the group, which nobody declared: "
            f"its replica in the cloud finds no server. Add to the node: uses: {{{_lines(actions, services)}}}; or "
            "list it under switching.silent"
        )


def _split(named: list[tuple[str, str]]) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return actions and services; an action is known by its hidden service for goals."""
    actions = [
        (name.removesuffix(_GOALS), type_name.removesuffix(_GOAL_TYPE))
        for name, type_name in named
        if name.endswith(_GOALS)
    ]
    return actions, [(name, type_name) for name, type_name in named if _HIDDEN not in name]


def _lines(actions: list[tuple[str, str]], services: list[tuple[str, str]], more: str = "") -> str:
    parts = []
    if actions:
        parts.append(f"actions: [{', '.join(f'{{name: {name}, type: {kind}{more}}}' for name, kind in actions)}]")
    if services:
        parts.append(f"services: [{', '.join(f'{{name: {name}, type: {kind}}}' for name, kind in services)}]")
    return ", ".join(parts)


def _listed(named: list[tuple[str, str]]) -> str:
    return ", ".join(name for name, _ in named)
