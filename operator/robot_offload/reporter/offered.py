"""The settings that the agent offers to its robot, and the answer to the robot's request for a certificate.

The reporter watches their ConfigMap and writes the agent's files.

A kubelet brings a changed ConfigMap into a pod's volume within its sync period (a minute by default) and its cache's.
People pin robots for safety, so this way is faster: a watch on the one ConfigMap. The volume counts while the API
server is unreachable, as when the pod starts without it.
"""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from pathlib import Path
from typing import Final

import structlog

from robot_offload.errors import RobotOffloadError
from robot_offload.kube.errors import ConflictError, SilentError
from robot_offload.kube.kinds import CONFIG_MAP
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.reporter.settings import Offered

IDLE_S: Final = 90.0
"""A watch that is silent for this long is reopened; the API server sends a bookmark each minute."""
FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 10.0
_GENERATION: Final = re.compile(r"^\s*generation: (\d+)\s*$", re.MULTILINE)
log = structlog.get_logger("robot_offload.reporter")


class OfferedSettings:
    """Keeps the agent's settings file as in the ConfigMap.

    Args:
        api: reads the ConfigMap.
        namespace: of the ConfigMap.
        offered: source and target of the settings.
    """

    def __init__(self, api: KubeApi, namespace: str, offered: Offered) -> None:
        self._api = api
        self._namespace = namespace
        self._name = offered.name
        self._mounted = offered.mounted
        self._file = offered.file
        self._answer = offered.answer

    async def keep(self) -> None:
        """Follow the ConfigMap until cancelled."""
        self._fall_back()
        version, failures = "", 0
        selection = Selection(fields=f"metadata.name={self._name}")
        while True:
            try:
                if not version:
                    version = self._take(await self._api.get(CONFIG_MAP, self._namespace, self._name))
                changes = self._api.watch(CONFIG_MAP, self._namespace, selection, version or "0", idle_s=IDLE_S)
                async for change in changes:
                    version, failures = change.version, 0
                    if change.type not in ("BOOKMARK", "DELETED"):
                        self._take(change.manifest)
            except (ConflictError, SilentError):
                version = ""
            except (RobotOffloadError, TimeoutError, OSError) as error:
                failures += 1
                if failures == 2:  # once an outage, not at each attempt
                    log.warning("the settings cannot be watched; the volume holds", error=str(error))
                version = ""
                self._fall_back()
                await asyncio.sleep(min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** min(failures, 8)))

    def _take(self, config_map: Manifest | None) -> str:
        """Write the API server's content; return its version."""
        found = config_map or {"metadata": {"resourceVersion": ""}}
        text = (found.get("data") or {}).get(self._mounted.name)
        if isinstance(text, str):
            self._write(text)
        answer = (found.get("data") or {}).get(self._answer.name)
        if isinstance(answer, str) and answer != _read(self._answer):
            _replace(self._answer, answer)
        return str(found["metadata"]["resourceVersion"])

    def _fall_back(self) -> None:
        """Use the kubelet's content if it is newer than the present file."""
        with suppress(OSError, UnicodeDecodeError):
            text = self._mounted.read_text(encoding="utf-8")
            if _generation(text) > _generation(_read(self._file)):
                self._write(text)

    def _write(self, text: str) -> None:
        if text == _read(self._file):
            return
        _replace(self._file, text)
        log.info("settings", generation=_generation(text))


def _replace(file: Path, text: str) -> None:
    """Write a file atomically: the agent never reads half of it."""
    passing = file.with_name(f".{file.name}.new")
    passing.write_text(text, encoding="utf-8")
    passing.chmod(0o644)
    passing.replace(file)


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _generation(text: str) -> int:
    """Return the generation of a settings file; -1: it has none."""
    found = _GENERATION.search(text)
    return int(found[1]) if found else -1
