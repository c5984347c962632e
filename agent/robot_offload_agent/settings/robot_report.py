"""The robot's own numbers for the cloud: one small message a second, in the words of metrics.

The robot's control process writes it, the cloud's puts it into its state file. Nothing depends on it: it may be lost,
late or missing; an invalid one is counted and skipped.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from typing import Any

from robot_offload_core.data.process import MAX_REPORT

VERSION = 1
FRESH_S = 5.0
"""An older report is no longer shown: a number that stands still is not a measurement."""
MOST = (32, 16, 8, 4, 0)
"""How many entries a list may have; while the whole is too large, the longest list goes one step further."""
DEPTH = 4


class ReportError(ValueError):
    """Text that is not a valid report; `reason`: BadForm or OtherVersion."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


class StrangerError(ReportError):
    """A report of a robot that is not served, or not yet: its first one may come before its first beat."""


def encode(incarnation: str, plain: Mapping[str, Any], lists: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a report of at most MAX_REPORT bytes.

    Args:
        incarnation: of the robot's control process.
        plain: values that are always included.
        lists: entries by name, the most important first; those without room are left out, and their number is given.
    """
    steps = dict.fromkeys(lists, 0)
    cut = {name: _first(entries, MOST[0]) for name, entries in lists.items()}
    while True:
        left_out = sum(len(entries) for entries in lists.values()) - sum(len(entries) for entries in cut.values())
        body = {"version": VERSION, "incarnation": incarnation, **plain, **cut, "left_out": left_out}
        text = _text(body)
        if len(text) <= MAX_REPORT or not any(cut.values()):
            return text
        longest = max(cut, key=lambda name: len(_text(cut[name])))
        steps[longest] += 1
        cut[longest] = _first(lists[longest], MOST[steps[longest]])


def _first(entries: Mapping[str, Any], most: int) -> dict[str, Any]:
    return dict(itertools.islice(entries.items(), most))


def _text(body: Mapping[str, Any]) -> str:
    return json.dumps(body, separators=(",", ":"))  # ASCII: as many bytes as characters


def decode(text: str, incarnation: str, topics: Mapping[str, str]) -> dict[str, Any]:
    """Return the report of the robot served, its topics by the names that people know.

    The consumer that makes metrics of it judges the fields; here it is small, flat and of this robot.

    Args:
        text: as received.
        incarnation: of the robot served.
        topics: topic by name of the input or output; entries of others are left out, so their number is bounded.

    Raises:
        StrangerError: it is of another robot.
        ReportError: it is not a report, or of a later version.
    """
    try:
        body = json.loads(text, parse_constant=lambda _: None)
    except (ValueError, RecursionError) as error:
        raise ReportError("BadForm", f"no JSON: {error}") from error
    if not isinstance(body, dict) or not _shallow(body, DEPTH):
        raise ReportError("BadForm", "no table of plain values")
    version = body.get("version")
    if version != VERSION:
        raise ReportError(
            "OtherVersion",
            f"The robot's report has version {version!r:.20}, this agent reads {VERSION}: install the same release of "
            "the agent on both sides; until then the robot's own numbers are missing",
        )
    if body.pop("incarnation", None) != incarnation:
        raise StrangerError("BadForm", "of a robot that is not served, or not yet")
    for name in ("topics", "gaps", "ages"):
        entries = body.get(name)
        if isinstance(entries, dict):
            body[name] = {topics[key]: value for key, value in entries.items() if key in topics}
    return body


def _shallow(value: object, depth: int) -> bool:
    """Return whether tables and lists are nested no deeper than that."""
    if not isinstance(value, dict | list):
        return True
    inner = value.values() if isinstance(value, dict) else value
    return depth > 0 and all(_shallow(each, depth - 1) for each in inner)
