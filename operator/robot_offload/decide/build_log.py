"""Selects from the last lines of a failed build those that show the cause."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, Final

from robot_offload.api.printable import printable
from robot_offload.kube.port import Manifest

MAX_LINES: Final = 5
_LINE_START: Final = 150
_LINE_END: Final = 400
# Lines that only report that a step failed, after its own error.
_AFTERMATH: Final = re.compile(
    r"(error: )?(building at STEP|while running runtime|exit status|subprocess exited)|time=\".*level=", re.IGNORECASE
)
_TELLING: Final = re.compile(r"error|fatal|failed|denied|unauthorized|no such|not found|cannot|unable|refused|has no")


def failing_lines(pods: Iterable[Manifest]) -> str:
    """Return the lines that show why a build failed, with the step; empty: the pods' statuses have none."""
    for pod in pods:
        status = pod.get("status") or {}
        for container in [*(status.get("initContainerStatuses") or ()), *(status.get("containerStatuses") or ())]:
            ended = (container.get("state") or {}).get("terminated") or {}
            if ended.get("exitCode"):
                return _told(str(container.get("name", "")), ended)
    return ""


def _told(step: str, ended: Mapping[str, Any]) -> str:
    lines = [printable(line).rstrip() for line in str(ended.get("message") or "").splitlines()]
    lines = [line for line in lines if line.strip()]
    causes = [line for line in lines if not _AFTERMATH.match(line.strip())] or lines
    last = max((i for i, line in enumerate(causes) if _TELLING.search(line.lower())), default=len(causes) - 1)
    chosen = causes[max(0, last - 1) : last + MAX_LINES - 1]
    if not chosen:
        chosen = [f"ended with code {ended['exitCode']} ({ended.get('reason', 'Error')}) and said nothing"]
    return "\n".join(f"{step}: {_cut(line)}" for line in chosen)


def _cut(line: str) -> str:
    """Shorten a long line in its middle: programs print what they did first and the cause last."""
    return line if len(line) <= _LINE_START + _LINE_END else f"{line[:_LINE_START]} ... {line[-_LINE_END:]}"
