"""A pin with an end: how the end is written beside a pin, and which pin is in force. Pure: time comes in.

The end stands in an annotation and not in the specification, so that an end needs no clock on the robot and a file in
version control needs no field for what somebody wishes for ten minutes. It names the side: an end that somebody wrote
for another pin ends nothing. Nobody rewrites the specification when the end has come; the pin just counts no more.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1.robotoffload import RobotOffload
from robot_offload.findings import Finding

PINNED_UNTIL: Final = "robotoffload.dev/pinned-until"
"""On a RobotOffload: the side that is pinned and when that ends, e.g. `Robot 2026-11-23T12:10:00Z`."""
AUTO: Final = "Auto"
LOOK_S: Final = 60.0
"""A wait for an end is never longer: clocks are set, and the steady clock of a wait does not see that."""
_FORM: Final = re.compile(r"(Robot|Cloud) ([0-9T:.Z+-]{20,40})")


@dataclass(frozen=True, slots=True)
class End:
    """The end of a pin: of which side's, and when."""

    side: str
    at: datetime.datetime


@dataclass(frozen=True, slots=True)
class Hold:
    """The pin that is in force.

    Attributes:
        side: Auto, Robot or Cloud.
        until: when it ends; None: when somebody lets go.
        ended: the end, as it was written, of a pin that counts no more; empty: there is none.
        recheck_s: seconds after which to look again; None: only after a change.
    """

    side: str
    until: datetime.datetime | None = None
    ended: str = ""
    recheck_s: float | None = None


NO_PIN: Final = Hold(AUTO)


def written(side: str, at: datetime.datetime) -> str:
    """Return the annotation's text: the end of a pin in whole seconds UTC."""
    return f"{side} {at.astimezone(datetime.UTC).strftime('%Y-%m-%dT%H:%M:%SZ')}"


def read(text: str) -> End | None:
    """Return the end that a text names; None: it names none."""
    found = _FORM.fullmatch(text)
    if found is None:
        return None
    try:
        at = datetime.datetime.fromisoformat(found[2])
    except ValueError:
        return None
    return End(found[1], at) if at.tzinfo else None


def _end_of(pin: str, text: str) -> End | None:
    """Return the end that a text names for this pin; None: for another one, or none."""
    end = read(text)
    return end if end is not None and pin != AUTO and end.side == pin else None


def hold(pin: str, text: str, ended: str, now: datetime.datetime) -> Hold:
    """Return the pin that is in force.

    Args:
        pin: of the specification.
        text: of the annotation; empty: there is none.
        ended: text of the end that was last found to have come: what has ended stays so when clocks are set back.
        now: the present.
    """
    end = _end_of(pin, text)
    if end is None:
        return Hold(pin)
    left_s = (end.at - now).total_seconds()
    if text == ended or left_s <= 0:
        return Hold(AUTO, ended=text)
    return Hold(pin, end.at, recheck_s=min(left_s, LOOK_S))


def observed(manifest: Mapping[str, Any]) -> Hold:
    """Return the pin that is in force, as the operator has found; `recheck_s` is left out.

    Args:
        manifest: a RobotOffload as the API server has it.
    """
    pin = str(((manifest.get("spec") or {}).get("switching") or {}).get("pin") or AUTO)
    text = str(((manifest.get("metadata") or {}).get("annotations") or {}).get(PINNED_UNTIL) or "")
    found = ((manifest.get("status") or {}).get("pin") or {}).get("ended")
    end = _end_of(pin, text)
    if end is None:
        return Hold(pin)
    return Hold(AUTO, ended=text) if text == found else Hold(pin, end.at)


def held(offload: RobotOffload, side: str) -> RobotOffload:
    """Return the resource with the pin that is in force in place of the one that is written."""
    if offload.spec.switching.pin == side:
        return offload
    switching = offload.spec.switching.model_copy(update={"pin": side})
    return offload.model_copy(update={"spec": offload.spec.model_copy(update={"switching": switching})})


def findings(offload: RobotOffload) -> Iterator[Finding]:
    """Yield what is wrong with the end of a pin; such a pin holds until it is taken back."""
    text = offload.metadata.annotations.get(PINNED_UNTIL, "")
    if text and read(text) is None:
        yield Finding(
            f'metadata.annotations["{PINNED_UNTIL}"]',
            "NoEnd",
            f"{text[:60]!r} is not a valid end of a pin, so the pin holds on; write a side and a time, "
            "such as Robot 2026-11-23T12:10:00Z",
            "warning",
        )
