"""A recording of a demo as a source: read once, scrolled through afterwards."""

from __future__ import annotations

import asyncio
import contextlib
import heapq
import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from robot_offload.console.live import Key
from robot_offload.console.model import Declared, Fleet
from robot_offload.console.source import Publish
from robot_offload.errors import InputError
from robot_offload_lab.console.told import Teller
from robot_offload_lab.console.unchangeable import Unchangeable
from robot_offload_lab.judge import recording
from robot_offload_lab.judge.lines import Record
from robot_offload_lab.judge.recording import Recording
from robot_offload_lab.show.watch import LiveRun

STEP_S: Final = 0.2
FILE: Final = "recording.jsonl"
RESOURCE: Final = "robotoffload.json"
"""Written by the demo beside its recording."""
NO: Final = "this is a recording: nothing can be changed in it"
PAUSE_EVERY: Final = 50


class RecordedSource(Unchangeable):
    """One recording.

    Args:
        path: the file, or the folder of a demo's report.

    Raises:
        InputError: there is no recording.
        RecordingError: the recording cannot be read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(NO)
        file = path / FILE if path.is_dir() else path
        if not file.is_file():
            raise InputError(f"RECORDING: {file} does not exist; name a demo's folder, or its {FILE}")
        self._recording = recording.read(file)
        self._manifest = _manifest(file.with_name(RESOURCE), self._recording)
        self._title = f"recording {file}"

    def fleet(self) -> Fleet:
        """See `Source.fleet`."""
        return Fleet(self._title, recorded=True)

    async def run(self, publish: Publish) -> None:
        """Publish the whole recording."""
        key = Key("", str(self._manifest["metadata"]["name"]))
        publish(Declared(key, self._manifest))
        run = self._recording.run
        watch = LiveRun(run.threshold_ms, outputs=tuple(self._recording.outputs), unrated=run.unrated)
        watch.start_s = run.start_s
        teller = Teller(key, -run.start_s)
        records = iter(_records(self._recording))
        record = next(records, None)
        steps = itertools.count()
        for step in steps:
            now_s = run.start_s + step * STEP_S
            while record is not None and record.t_s <= now_s:  # type: ignore[attr-defined]  # all but the run have it
                watch.take_record(record)
                record = next(records, None)
            watch.attend(now_s)
            for event in teller.tell(watch, now_s):
                publish(event)
            if record is None:
                return
            if step % PAUSE_EVERY == 0:
                await asyncio.sleep(0)  # pages are served meanwhile


def _records(found: Recording) -> Iterator[Record]:
    """Yield all records but the run's own, in the order of time."""
    streams: list[tuple[Any, ...]] = [
        *found.outputs.values(), found.placements, found.link, found.inhibits, found.goals, found.calls, found.restored,
    ]  # fmt: skip
    yield from heapq.merge(*streams, key=lambda record: record.t_s)


def _manifest(file: Path, found: Recording) -> Mapping[str, Any]:
    """Return the resource that ran: as the demo wrote it, or as far as the recording itself states it."""
    with contextlib.suppress(OSError, ValueError):
        read: Any = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(read, dict) and isinstance(read.get("metadata"), dict) and read["metadata"].get("name"):
            return read
    run = found.run
    latency = {
        "robotPeriod": f"{run.robot_period_ms:.0f}ms",
        "cloudPeriod": f"{run.cloud_period_ms:.0f}ms",
        "tolerance": f"{max(0.0, run.threshold_ms + run.cloud_period_ms - run.robot_period_ms):.0f}ms",
    }
    switching = {"latency": latency, "lossTimeout": f"{run.loss_timeout_ms:.0f}ms"}
    return {"metadata": {"name": run.mode}, "spec": {"switching": switching}}
