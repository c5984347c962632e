"""Parameters of state: what the standby continuously receives from a node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings.parameter import TOPIC, Parameter
from robot_offload_core.words.declared import (
    MEBIBYTE,
    ParameterState,
    SettingsError,
    SnapshotState,
    StateSpec,
    TopicState,
)

STATE: dict[str, Parameter] = {
    "node": Parameter(None, "the node whose state it is"),
    "kind": Parameter(None, "what is kept", choices=("Topic", "Parameters", "Snapshot")),
    "topic": Parameter("", "Topic: what the node publishes", pattern=rf"({TOPIC})?"),
    "restore": Parameter("", "Topic: where the node takes it from", pattern=rf"({TOPIC})?"),
    "nodes": Parameter(["none"], "Parameters: nodes whose parameters are copied; none: the node alone"),
    "except": Parameter(["none"], "Parameters: names that each side keeps for itself"),
    "max_age_ms": Parameter(500.0, "Snapshot: oldest one that counts as up to date, ms", low=1, high=60000),
    "max_size": Parameter(MEBIBYTE, "Snapshot: largest one that is taken, bytes", low=1, high=16 * MEBIBYTE),
}
KEPT: dict[str, tuple[str, dict[str, Parameter]]] = {"states": ("state", STATE)}


def state_spec(name: str, values: Mapping[str, Any]) -> StateSpec:
    """Return one entry of state; raise ConfigurationError naming the parameter that cannot work."""
    node = values["node"]
    spec: StateSpec
    if values["kind"] == "Topic":
        spec = TopicState(node, values["topic"], values["restore"])
    elif values["kind"] == "Parameters":
        spec = ParameterState(node, _given(values["nodes"]), _given(values["except"]))
    else:
        spec = SnapshotState(node, values["max_age_ms"] / 1e3, values["max_size"])
    try:
        spec.check()
    except SettingsError as error:
        raise ConfigurationError(f"parameter state.{name}.{error}") from error
    return spec


def _given(words: list[str]) -> tuple[str, ...]:
    return tuple(word for word in words if word != "none")
