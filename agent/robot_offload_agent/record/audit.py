"""Writes the audit trail of a robot (`robot_offload_core.record.audit`) to its disk, on a thread of its own.

The files `audit/audit-NUMBER.log` in the state folder are one chain; a full one is followed by the next, and the oldest
is deleted. Each entry is synced to the disk. An entry that cannot be written is tried again each second. Entries
without room are counted, and an entry states that. A second agent with the same folder writes nothing and reports it.
"""

from __future__ import annotations

import datetime
import fcntl
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from robot_offload_agent.runtime import threads
from robot_offload_agent.settings.override import state_dir
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.control.robot import placement
from robot_offload_core.control.robot.process import FROM_CLOUD
from robot_offload_core.record import audit
from robot_offload_core.record.audit import Head, Kind
from robot_offload_core.words.events import Machine

log = logging.getLogger(__name__)

FILE_BYTES = 1 << 20
FILES = 16
"""Number of files kept: some 60,000 entries, years of an ordinary robot."""
WAITING = 1000
RETRY_S = 1.0
FOLDER = "audit"

Said = tuple[str, Kind, str, Mapping[str, str]]


class AuditTrail:
    """Writer of the audit trail; also a witness of the placement machine (`robot_offload_core.words.events.Witness`).

    Attributes:
        head: the newest entry on the disk.
        missed: entries that found no room.
        problem: why nothing is written now; "" if there is none.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.head = Head()
        self.missed = 0
        self.problem = ""
        self._waiting: deque[Said] = deque()
        self._wake = threading.Event()
        self._lock: IO[str] | None = None
        self._file: Path | None = None
        self._unsaid = 0

    # -- deciding thread ----------------------------------------------------------------------------------------------

    def say(self, kind: Kind, who: str, **what: str) -> None:
        """Take an entry; return at once."""
        if len(self._waiting) >= WAITING:
            self.missed += 1
            self._unsaid += 1
            return
        self._waiting.append((_now(), kind, who, what))
        self._wake.set()

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Take a step: switches by hand, and pins of the robot itself, become entries."""
        if machine is not Machine.PLACEMENT:
            return
        if isinstance(event, placement.SwitchByHand):
            where = "service in the cloud" if event.key == FROM_CLOUD else "service on the robot"
            self.say(Kind.SWITCH_BY_HAND, where, to=event.site.value, epoch=str(after.epoch))
        elif isinstance(event, placement.SetPin):
            pin = event.pin
            self.say(
                Kind.OVERRIDE, "parameter `override` on the robot", to=pin.site.value if pin else "Auto",
                for_s="" if pin is None or pin.until_s is None else f"{max(0.0, pin.until_s - now_s):.0f}",
            )  # fmt: skip

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Ignore a state that no step has led to: no user caused it."""

    def broke(self, machine: Machine, now_s: float, event: Any, rule: str) -> None:
        """Ignore a step that broke a rule: no user caused it."""

    # -- writing thread -----------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Begin to write, in a thread of its own."""
        threads.start("audit", self._run)

    def _run(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            while not self.turn():
                time.sleep(RETRY_S)

    def turn(self) -> bool:
        """Write what waits; return False if something is left to be tried again."""
        try:
            if self._lock is None:
                self._open()
            while self._waiting:
                self._write(*self._waiting[0])
                self._waiting.popleft()
            if self._unsaid:
                count, self._unsaid = self._unsaid, 0
                self._write(_now(), Kind.MISSED, "agent", {"entries": str(count)})
        except BlockingIOError:
            self._fail("another agent writes there")
        except OSError as error:
            self._fail(error.strerror or str(error))
        else:
            self.problem = ""
        return not self.problem

    def close(self) -> None:
        """Release the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _fail(self, why: str) -> None:
        problem = f"{self.folder} cannot be written: {why}"
        if problem != self.problem:
            self.problem = problem
            log.warning("%s; the agent goes on reason=AuditFailed", problem)

    def _open(self) -> None:
        """Take the folder, and continue the chain in it."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = (self.folder / "lock").open("a")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._go_on()
        except OSError:
            lock.close()
            raise
        self._lock = lock

    def _go_on(self) -> None:
        found = files(self.folder)
        self._file = found[-1] if found else self.folder / _name(1)
        torn = False
        for file in reversed(found):
            text = file.read_text(encoding="ascii", errors="replace")
            torn = torn or (bool(text) and not text.endswith("\n"))
            entries = [entry for each in text.splitlines() if (entry := audit.parse(each)) is not None]
            if entries:
                self.head = entries[-1].head
                break
        if torn:
            with self._file.open("a", encoding="ascii") as out:
                out.write("\n")
            self._write(_now(), Kind.TORN, "agent", {"found": "the last line was not whole"})

    def _write(self, at: str, kind: Kind, who: str, what: Mapping[str, str]) -> None:
        assert self._file is not None
        head, text = audit.line(self.head, at, kind, who, what)
        size = self._file.stat().st_size if self._file.exists() else 0
        if size and size + len(text) > FILE_BYTES:
            self._file = self.folder / _name(_number(self._file) + 1)
            for old in files(self.folder)[: -(FILES - 1)]:
                old.unlink(missing_ok=True)
            size = 0
        with self._file.open("ab", buffering=0) as out:
            try:
                written = out.write(text.encode("ascii"))
                if written != len(text):
                    raise OSError(28, "No space left on device")
                os.fsync(out.fileno())
            except OSError:
                os.truncate(self._file, size)  # half a line would be in the way of the next try
                raise
        self.head = head


def files(folder: Path) -> list[Path]:
    """Return the files of a trail, the oldest first."""
    return sorted(file for file in folder.glob("audit-*.log") if file.stem[len("audit-") :].isdigit())


def lines(folder: Path) -> list[str]:
    """Return the lines of a trail with their ends, the oldest first; raise OSError."""
    return [
        line for file in files(folder)
        for line in file.read_text(encoding="ascii", errors="replace").splitlines(keepends=True)
    ]  # fmt: skip


def of(configuration: Configuration) -> AuditTrail:
    """Return the trail of a robot."""
    return AuditTrail(state_dir(configuration) / FOLDER)


def _name(number: int) -> str:
    return f"audit-{number:08d}.log"


def _number(file: Path) -> int:
    return int(file.stem[len("audit-") :])


def _now() -> str:
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="milliseconds").replace("+00:00", "Z")
