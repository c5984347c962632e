"""What the agents warn of in a run: each problem of a side once, with its next step, read from the agents' logs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload_core.control.nodes.managed_nodes import NodeEvent
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.reasons import Reason

_LINE: Final = re.compile(r"\S+ WARNING (?P<side>robot|cloud)\.report: (?P<message>.+) reason=(?P<reason>\w+)")
"""A new problem in an agent's log (robot_offload_agent.ros.report); other warnings concern the link and the nodes."""
STARTING: Final = frozenset({Problem.NO_PUBLISHER, Problem.NODE_UNSEEN, Problem.REPLICA_MISSING, NodeEvent.DEGRADED})
"""True of every start: nodes come up one after the other."""
_ADVICE: Final = {word.value: word.advice for kind in (Reason, NodeEvent, Problem) for word in kind}


@dataclass(frozen=True)
class Warned:
    """A problem that an agent reported.

    Attributes:
        side: robot or cloud.
        reason: its word.
        message: a sentence with names and values.
        advice: the next step; "" where none is known.
    """

    side: str
    reason: str
    message: str
    advice: str

    def sentence(self) -> str:
        """Return it in one line."""
        said = f"The {self.side}'s agent warns: {self.message} ({self.reason})"
        return f"{said}. {self.advice}" if self.advice else said


def parse(line: str) -> Warned | None:
    """Return the problem in a line of an agent's log; None where it is another line."""
    found = _LINE.fullmatch(line)
    if found is None:
        return None
    return Warned(found["side"], found["reason"], found["message"], _ADVICE.get(found["reason"], ""))


class Warnings:
    """Follows the logs of both agents.

    Attributes:
        found: each problem of a side once, in the order of the first words about it.
        starting: nodes still come up, so problems of STARTING are left out.
    """

    def __init__(self, logs: Mapping[str, Path]) -> None:
        """Follow the logs, by side; a log may not be there yet."""
        self.found: list[Warned] = []
        self.starting = True
        self._logs = logs
        self._read: dict[str, int] = dict.fromkeys(logs, 0)

    def look(self) -> Iterator[Warned]:
        """Yield problems that were written since the last look and that are new."""
        for side, log in self._logs.items():
            for line in self._lines(side, log):
                warned = parse(line)
                if warned is not None and not self._left_out(warned):
                    self.found.append(warned)
                    yield warned

    def _left_out(self, warned: Warned) -> bool:
        known = any((each.side, each.reason) == (warned.side, warned.reason) for each in self.found)
        return known or (self.starting and warned.reason in STARTING)

    def _lines(self, side: str, log: Path) -> list[str]:
        """Return whole lines that are new; a line that is still being written waits for the next look."""
        try:
            with log.open("rb") as file:
                file.seek(self._read[side])
                written = file.read()
        except OSError:
            return []
        whole, _, _ = written.rpartition(b"\n")
        self._read[side] += len(whole) + 1 if whole else 0
        return whole.decode("utf-8", "replace").splitlines()
