"""Parameters of services and actions: those that duplicated nodes serve, and those outside that they use."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings.parameter import TOPIC, Parameter
from robot_offload_core.fence.token import Site
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import (
    WITHOUT_LIMIT_S,
    Accept,
    ActionSpec,
    OnSwitch,
    ServiceMode,
    ServiceSpec,
    SettingsError,
    UsedAction,
    UsedService,
)
from robot_offload_core.words.settings import Settings

_MEMBER = re.compile(r"/offload/cloud/(?P<member>pod_[a-z0-9_]+)(?P<name>/.+)")
"""Only pods of pools have names with this beginning: public names of the group may not begin with /offload."""
Spec = ServiceSpec | ActionSpec | UsedService | UsedAction
_SERVICE = r"[a-z][a-z0-9_]*/srv/[A-Z][A-Za-z0-9]*"
_ACTION = r"[a-z][a-z0-9_]*/action/[A-Z][A-Za-z0-9]*"
_COMMON: dict[str, Parameter] = {
    "name": Parameter(None, "public name", pattern=TOPIC),
    "node": Parameter("", "the node that serves or uses it"),
    "timeout_ms": Parameter(2000.0, "longest wait for an answer, ms", low=10, high=3.6e6),
    "of_cloud": Parameter(False, "its node runs in the cloud only"),
}
_SERVED: dict[str, Parameter] = {
    **_COMMON,
    "core": Parameter(False, "the robot must not move without its node"),
    "hot": Parameter(["none"], "sides on which its node stays Active in standby: robot, cloud"),
}
SERVICE: dict[str, Parameter] = {
    **_SERVED,
    "type": Parameter(None, "interface type", pattern=_SERVICE),
    "mode": Parameter("Holder", "who executes a call", choices=tuple(m.value for m in ServiceMode)),
    "pooled": Parameter(False, "its node has several pods, each of which serves it under a name of its own"),
}
ACTION: dict[str, Parameter] = {
    **_SERVED,
    "type": Parameter(None, "interface type", pattern=_ACTION),
    "on_switch": Parameter(
        None, "what becomes of a running goal at a switch", choices=tuple(o.value for o in OnSwitch)
    ),
    "accept": Parameter("Relay", "who answers a client that sends a goal", choices=tuple(a.value for a in Accept)),
    "hold_for_ms": Parameter(
        0.0, "longest wait of a planned switch for a Hold goal's end, ms; 0: no limit", low=0, high=3.6e6
    ),
    "result_timeout_ms": Parameter(900000.0, "how long a result is kept for its client, ms", low=1, high=8.64e7),
    "mirror": Parameter(False, "live goals are offered to the Hot standby too"),
}
USED_SERVICE: dict[str, Parameter] = {**_COMMON, "type": Parameter(None, "interface type", pattern=_SERVICE)}
USED_ACTION: dict[str, Parameter] = {
    **_COMMON,
    "type": Parameter(None, "interface type", pattern=_ACTION),
    "cancel_after_ms": Parameter(
        500.0, "how long a goal of the side left behind runs on after a switch, ms", low=0, high=60000
    ),
}
SERVED: dict[str, tuple[str, dict[str, Parameter]]] = {
    "services": ("service", SERVICE),
    "actions": ("action", ACTION),
    "used_services": ("used_service", USED_SERVICE),
    "used_actions": ("used_action", USED_ACTION),
}
"""By the list of their identifiers: prefix and members of the parameters."""
_KINDS: dict[str, Callable[..., Spec]] = {
    "services": ServiceSpec, "actions": ActionSpec, "used_services": UsedService, "used_actions": UsedAction,
}  # fmt: skip
_WORDS: dict[str, Callable[[Any], Any]] = {"mode": ServiceMode, "on_switch": OnSwitch, "accept": Accept}


def private_name(side: str, name: str) -> str:
    """Return the name by which a side's group serves or uses a public name."""
    return f"/offload/{side}{name}"


def member_in(full: str, name: str) -> str | None:
    """Return the pod of a pool that serves a public name under a private one; None for another name."""
    found = _MEMBER.fullmatch(full)
    return found["member"] if found is not None and found["name"] == name else None


def relay_plan(declared: Mapping[str, Sequence[tuple[str, Mapping[str, Any]]]], settings: Settings) -> RelayPlan:
    """Return the core's plan of a relay.

    Args:
        declared: (identifier, values) of each member, by list.
        settings: of the core.

    Raises:
        ConfigurationError: a value cannot work; names the parameter.
    """
    specs: dict[str, tuple[Any, ...]] = {
        group: tuple(_spec(group, name, values) for name, values in members) for group, members in declared.items()
    }
    return RelayPlan(
        **specs, prepare_deadline_s=settings.preparing_s, cancel_deadline_s=settings.cancel_deadline_s,
        lease_s=settings.lease_s,
    )  # fmt: skip


def _spec(group: str, name: str, values: Mapping[str, Any]) -> Spec:
    prefix = f"parameter {SERVED[group][0]}.{name}"
    given: dict[str, Any] = {}
    for key, value in values.items():
        if key == "hold_for_ms" and not value:
            given["hold_for_s"] = WITHOUT_LIMIT_S
        elif key.endswith("_ms"):
            given[f"{key[:-3]}_s"] = value / 1e3
        elif key == "hot":
            given[key] = _sides(prefix, value)
        else:
            given[key] = _WORDS[key](value) if key in _WORDS else value
    spec = _KINDS[group](**given)
    try:
        spec.check()
    except SettingsError as error:
        raise ConfigurationError(f"{prefix}.{error}") from error
    return spec


def _sides(prefix: str, words: list[str]) -> tuple[Site, ...]:
    try:
        return tuple(Site(word) for word in words if word != "none")
    except ValueError as error:
        raise ConfigurationError(f"{prefix}.hot: {error}; write robot, cloud or both") from error
