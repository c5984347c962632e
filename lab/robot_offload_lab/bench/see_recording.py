"""What the robot's agent spends on being seen: recorder of changeovers, black box, audit trail, the report of numbers.

A run of the wheelchair with real processes and a link that is cut now and then. Read from the accounts of the kernel,
to the nanosecond, of the record process and of the writing threads of the control process. The report has no thread of
its own: what the deciding thread spends on it is a counter in the recording of the run.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from rich.console import Console

from robot_offload.api.v1alpha1 import Record, RobotOffload
from robot_offload.errors import RobotOffloadError
from robot_offload_lab.bench.see_figures import SeeFigure
from robot_offload_lab.run.demo import DemoOptions, run
from robot_offload_lab.show.view import LineView
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

SECONDS: Final = 40.0
SETTLED_S: Final = 5.0
"""What the start of the processes costs is no part of it."""
LOOK_S: Final = 1.0
AIM: Final = "under 0.5 % of a core"
COUNTER: Final = "report.cpu_us"
"""In the robot's /diagnostics: what the deciding thread has spent on the report."""
PROCESS: Final = "ro-robot-"
FILE: Final = Path("examples/wheelchair/robotoffload.yaml")


@dataclass
class Watch(threading.Thread):
    """Reads what the threads of a run's robot agent have used, once a second.

    Attributes:
        folder: working directory of the run's agents.
        used: (time, seconds of processor time) by the name of process and thread.
        memory: newest proportional set size of each process, bytes.
    """

    folder: Path
    used: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    memory: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()

    def __hash__(self) -> int:
        return id(self)

    def run(self) -> None:
        """Reads until it is over."""
        while not self.over.wait(LOOK_S):
            for process in psutil.process_iter(["name"]):
                if str(process.info["name"]).startswith(PROCESS):
                    with suppress(psutil.Error, OSError):
                        self._read(process)

    def _read(self, process: psutil.Process) -> None:
        if Path(process.cwd()) != self.folder:
            return
        name, now_s = process.name(), steady_s()
        for thread in process.threads():
            comm = Path(f"/proc/{process.pid}/task/{thread.id}/comm").read_text().strip()
            said = self.used.setdefault(f"{name}/{comm if comm != name else thread.id}", [])
            spent_ns = Path(f"/proc/{process.pid}/task/{thread.id}/schedstat").read_text().split()[0]
            said.append((now_s, int(spent_ns) / 1e9))
        self.memory[name] = process.memory_full_info().pss

    def percent(self, *beginnings: str) -> float | None:
        """Returns the share of a core of all threads whose names begin so, after the start; None: there is none."""
        shares = list(self._shares(beginnings))
        return sum(shares) if shares else None

    def _shares(self, beginnings: tuple[str, ...]) -> Iterator[float]:
        for name, said in self.used.items():
            settled = [one for one in said if one[0] >= said[0][0] + SETTLED_S]
            if name.startswith(beginnings) and len(settled) > 1:
                (first_s, before_s), (last_s, after_s) = settled[0], settled[-1]
                yield 100.0 * (after_s - before_s) / (last_s - first_s)


def measure(out: Path) -> list[SeeFigure]:
    """Runs the wheelchair for 40 s with cuts, and returns what recorder, black box and audit trail used."""
    if not FILE.exists():
        raise RobotOffloadError(f"{FILE}: run this in a checkout of the repository")
    folder = (out / "recording").resolve()
    watch = Watch(folder)
    watch.start()
    options = DemoOptions(FILE, duration_s=SECONDS, link=LinkOptions(outages=("2/12",)), out=folder, adapt=_recorded)
    run(options, LineView(Console(stderr=True)))
    watch.over.set()
    watch.join()
    box, control = (folder / "state" / "robot" / "blackbox" / "robot"), "ro-robot-contro"
    written = sum(file.stat().st_size for file in box.glob("box-*.log"))
    files = list((folder / "state" / "robot" / "recordings").glob("*.mcap"))
    memory = watch.memory.get("ro-robot-record")
    return [
        SeeFigure("recorder of changeovers, robot", watch.percent("ro-robot-record"), "% of a core"),
        SeeFigure("its memory (PSS)", None if memory is None else memory / 2**20, "MiB"),
        SeeFigure("recordings written", float(len(files)), "files"),
        SeeFigure("black box, robot: writing thread", watch.percent(f"{control}/blackbox"), "% of a core", AIM),
        SeeFigure("black box, robot: written", written / SECONDS / 1000, "kB/s"),
        SeeFigure("audit trail: writing thread", watch.percent(f"{control}/audit"), "% of a core"),
        SeeFigure("report of the robot's numbers", _report_percent(folder / "run.mcap"), "% of a core"),
        SeeFigure("whole agent of the robot", watch.percent(PROCESS), "% of a core"),
    ]


def _report_percent(file: Path) -> float | None:
    """Returns the share of a core that the robot's report takes, from the counter in a run's recording."""
    counts: list[tuple[float, int]] = []
    with file.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=["/diagnostics"]):
            for status in deserialize_message(message.data, DiagnosticArray).status:
                counts += [(message.log_time / 1e9, int(it.value)) for it in status.values if it.key == COUNTER]
    settled = [one for one in counts if one[0] >= counts[0][0] + SETTLED_S]
    if len(settled) < 2:
        return None
    (first_s, before_us), (last_s, after_us) = settled[0], settled[-1]
    return 100.0 * (after_us - before_us) / 1e6 / (last_s - first_s)


def _recorded(offload: RobotOffload) -> RobotOffload:
    record = Record(switches=True)
    return offload.model_copy(update={"spec": offload.spec.model_copy(update={"record": record})})
