"""A proposed RobotOffload: its values, each with a comment for the reader of the file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload.api.v1alpha1.robotoffload import API_VERSION, KIND

LISTS: Final = ("outputs", "services", "actions", "state")


@dataclass(slots=True)
class Entry:
    """One entry of a list, with its comment."""

    value: dict[str, Any]
    note: str = ""


@dataclass(slots=True)
class NodeSketch:
    """A node.

    Attributes:
        notes: lines above it.
        fields: its plain fields.
        lists: outputs, services, actions, state.
        uses: services and actions that it calls.
    """

    name: str
    placement: str
    notes: list[str] = field(default_factory=list)
    fields: dict[str, Any] = field(default_factory=dict)
    lists: dict[str, list[Entry]] = field(default_factory=lambda: {name: [] for name in LISTS})
    uses: dict[str, list[Entry]] = field(default_factory=lambda: {"services": [], "actions": []})

    def values(self) -> dict[str, Any]:
        """Return the node in the resource's form."""
        lists = {name: [it.value for it in entries] for name, entries in self.lists.items() if entries}
        uses = {name: [it.value for it in entries] for name, entries in self.uses.items() if entries}
        return {"name": self.name, "placement": self.placement, **self.fields, **lists,
                **({"uses": uses} if uses else {})}  # fmt: skip


@dataclass(slots=True)
class Sketch:
    """The whole file.

    Attributes:
        head: lines at its beginning.
        spec: plain blocks of the spec in their order: robot, cloud, transport, driver, switching.
        notes: block -> its comment.
        left_out: lines at its end.
    """

    name: str
    head: list[str] = field(default_factory=list)
    spec: dict[str, dict[str, Any]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)
    to_cloud: list[Entry] = field(default_factory=list)
    nodes: list[NodeSketch] = field(default_factory=list)
    silent: list[Entry] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def values(self) -> dict[str, Any]:
        """Return the file as plain values."""
        spec: dict[str, Any] = {name: it for name, it in self.spec.items() if it and name != "switching"}
        if self.to_cloud:
            spec["topics"] = {"toCloud": [it.value for it in self.to_cloud]}
        spec["nodes"] = [it.values() for it in self.nodes]
        switching = dict(self.spec.get("switching", {}))
        if self.silent:
            switching["silent"] = [it.value["name"] for it in self.silent]
        if switching:
            spec["switching"] = switching
        return {"apiVersion": API_VERSION, "kind": KIND, "metadata": {"name": self.name}, "spec": spec}


def plain(text: str) -> str:
    """Return foreign text in a form for a comment: one line, ASCII, no longer than a name can be."""
    shown = ascii(text)[1:-1].replace("#", "")
    return shown if len(shown) <= 100 else f"{shown[:96]}..."
