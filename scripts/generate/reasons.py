"""The reference page of everything that agents and core give as a reason, from the enumerations themselves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from robot_offload_agent.link.port import LinkCause
from robot_offload_agent.settings.offer import Answer
from robot_offload_core.control.cloud.lease import Stand
from robot_offload_core.control.nodes.managed_nodes import NodeEvent
from robot_offload_core.control.robot.limits import LIMITS, Basis
from robot_offload_core.words.gates import Ruling
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.reasons import Explained, Kind, Reason

_HEAD: Final = """\
<!-- Generated from the enumerations in core and agent by `make generate`; changes here are lost. -->
# Reasons

Whatever the agents decide or report carries one of these words: the log (`reason=`), `/offload/placement`,
`/diagnostics`, the robot's Lease and with it the status of the RobotOffload. A word never changes its meaning; the
message beside it gives names and figures.

## Why a side is in charge

From the strongest to the weakest. A **hard limit** ends a stay in the cloud at once and forbids the next one. A
**veto** makes the robot take over as if it was pinned. A *pin* and a switch *by hand* come from people. An *attempt* is
a changeover that did not succeed; the next one waits longer. The *policy* weighs the link.

Limits that are judged by *silence* wait for what is still unread when the robot's own control process was late; those
that are *reported* are judged at once.
"""
_KINDS: Final = {Kind.LIMIT: "**hard limit**", Kind.VETO: "**veto**"}


def reasons() -> str:
    """Return the page as Markdown."""
    bases = {limit.reason: limit.basis for limit in reversed(LIMITS)}
    head = ["| Reason | What it is | Cause | Next step |", "|---|---|---|---|"]
    rows = [
        f"| `{reason}` | {_kind(reason, bases.get(reason))} | {reason.cause} | {reason.advice or '-'} |"
        for kind in Kind
        for reason in Reason
        if reason.kind is kind
    ]
    parts = [
        _HEAD, "\n".join(head + rows), "",
        "## What the cloud's side does", "", _table(Stand), "",
        "## What happens to managed nodes", "", _table(NodeEvent), "",
        "## Problems in /diagnostics", "", _table(Problem), "",
        "## The link", "", "As `cause` in the status `link`; the message says what to do.", "",
        _table(cause for cause in LinkCause if cause), "",
        "## The robot's answer to settings of the cloud", "", _table(Answer), "",
        "## What becomes of a message at the collector", "",
        "Counted in `/diagnostics` as `OUTPUT.SIDE.REASON`; a message that passes counts as `passed`.", "",
        _table(Ruling), "",
    ]  # fmt: skip
    return "\n".join(parts)


def _kind(reason: Reason, basis: Basis | None) -> str:
    name = _KINDS.get(reason.kind, reason.kind.value)
    return f"{name}, {basis.value}" if basis is not None else name


def _table(words: Iterable[Explained]) -> str:
    rows = [f"| `{word}` | {word.cause} | {word.advice or '-'} |" for word in words]
    return "\n".join(["| Reason | Cause | Next step |", "|---|---|---|", *rows])
