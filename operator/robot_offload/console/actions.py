"""The actions on a robot's page, as changes of the resource. Pure: the API server decides who may do them."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL, written
from robot_offload.insight.observed import Observed

TAKE_OVER_S: Final = 60.0
"""How long a takeover by hand is kept: longer than a person needs to look, and to pin it for good."""


class Want(Enum):
    """The possible actions."""

    PIN_ROBOT = "Pin to the robot"
    PIN_CLOUD = "Pin to the cloud"
    AUTO = "Let the rule decide"
    OBSERVE = "Observe only"
    SWITCH = "Switch again"
    TAKE_OVER = "Robot takes over now"


@dataclass(frozen=True, slots=True)
class Action:
    """An action of a person; `for_s`: how long a pin lasts, None: until it is removed."""

    want: Want
    for_s: float | None = None


@dataclass(frozen=True, slots=True)
class Permission:
    """Whether the user may do something; `reason`: why not."""

    allowed: bool
    reason: str = ""


ALLOWED: Final = Permission(True)
_PINS: Final = {Want.PIN_ROBOT: "Robot", Want.PIN_CLOUD: "Cloud", Want.AUTO: "Auto", Want.TAKE_OVER: "Robot"}
_MODES: Final = {Want.OBSERVE: "Observe", Want.SWITCH: "Auto"}


def patch(action: Action, uid: str, now: datetime.datetime) -> dict[str, Any]:
    """Return the merge patch of the RobotOffload with this uid.

    Args:
        action: to apply.
        uid: so that another object of the same name is not changed.
        now: the present.
    """
    metadata: dict[str, Any] = {"uid": uid}
    if action.want in _MODES:
        return {"metadata": metadata, "spec": {"switching": {"mode": _MODES[action.want]}}}
    for_s = TAKE_OVER_S if action.want is Want.TAKE_OVER else action.for_s
    until = None
    if for_s is not None and action.want is not Want.AUTO:
        until = written(_PINS[action.want], now + datetime.timedelta(seconds=for_s))
    metadata["annotations"] = {PINNED_UNTIL: until}
    return {"metadata": metadata, "spec": {"switching": {"pin": _PINS[action.want]}}}


def done(action: Action, after: Observed) -> str:
    """Return what was done, as a sentence."""
    if action.want in _MODES:
        word = "it decides and never switches" if after.mode == "Observe" else "it switches again"
        return f"{after.name}: mode {after.mode}, {word}; generation {after.generation}"
    if after.pin == "Auto":
        return f"{after.name}: the rule decides again; generation {after.generation}"
    heard = "" if after.connected else "; the robot is not connected and hears it when it connects"
    lasting = "for a minute" if action.want is Want.TAKE_OVER else _lasting(action.for_s)
    return f"{after.name}: held on the {after.pin.lower()} {lasting}; generation {after.generation}{heard}"


def useless(action: Action, observed: Observed | None) -> str:
    """Return why an action would have no effect now; empty: it would have one."""
    if observed is None:
        return "there is no resource to change"
    if action.want in _PINS and action.want is not Want.TAKE_OVER and _PINS[action.want] == observed.pin:
        same = action.for_s is None and not observed.pinned_until
        return f"the pin is {observed.pin} already" if same else ""
    if action.want in _MODES and _MODES[action.want] == observed.mode:
        return f"the mode is {observed.mode} already"
    return ""


def _lasting(for_s: float | None) -> str:
    if for_s is None:
        return "until it is taken back"
    return f"for {for_s / 60:.0f} min" if for_s >= 60 else f"for {for_s:.0f} s"
