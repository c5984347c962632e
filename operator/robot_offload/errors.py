"""The errors shown to users, in one tree. The command line prints their lines and exits with their code.

RobotOffloadError      exit code 1
`- InputError          exit code 2: a file or an option is wrong; nothing was started
   |- SpecError        a RobotOffload specification, with every problem at once
   `- RecordingError   a recording of a run that cannot be read

Errors of a single module are in that module and derive from one of the first two.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from robot_offload.findings import Finding


class RobotOffloadError(Exception):
    """An error that we can explain; the message gives the next step."""

    exit_code: ClassVar[int] = 1

    @property
    def lines(self) -> tuple[str, ...]:
        """The text to print, one problem a line."""
        return tuple(str(self).splitlines())


class InputError(RobotOffloadError):
    """The input (a file, an option) is wrong; running the same command again cannot help."""

    exit_code = 2


class SpecError(InputError):
    """A RobotOffload specification is refused.

    Attributes:
        source: the file (or another origin) that was read.
        findings: every problem, in the order of the file's fields as far as possible; never empty.
    """

    def __init__(self, source: str, findings: Sequence[Finding]) -> None:
        self.source = source
        self.findings = tuple(findings)
        super().__init__("\n".join(self.lines))

    @property
    def lines(self) -> tuple[str, ...]:
        """One line per problem: `file: spec.nodes[1].name: message`."""
        return tuple(f"{self.source}: {finding.line()}" for finding in self.findings)


class RecordingError(InputError):
    """A recording cannot be read; the message names the file and the line."""
