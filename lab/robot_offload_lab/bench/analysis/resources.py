"""What the agents cost: processor time and memory of all their processes, the supervisor included."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import Figure, GroupResult, Priority

GROUP: Final = "resources"
CPU_MUST: Final = 10.0
CPU_AIM: Final = 8.0
PSS_MUST_MB: Final = 120.0
PSS_AIM_MB: Final = 110.0
MB: Final = 1e6
PROCESSES: Final = ("collector", "control", "data", "pulse", "relay")


@dataclass(frozen=True)
class Usage:
    """One process at one moment.

    Attributes:
        name: as shown by ps.
        cpu_s: processor time used so far.
        pss_bytes: proportional set size: shared pages count in shares.
        anonymous_bytes: the part of it that no file backs.
        file_bytes: by mapped file, how much of it is in memory for this process.
    """

    name: str
    cpu_s: float
    pss_bytes: int
    anonymous_bytes: int
    file_bytes: Mapping[str, int]


@dataclass(frozen=True)
class Cost:
    """One process over the whole time; `name` is that of the agent's process, such as `data`."""

    name: str
    cpu_percent: float
    pss_mb: float


@dataclass(frozen=True)
class Weighed:
    """Both agents over one observation.

    Attributes:
        case: what they were busy with.
        seconds: for how long.
        robot, cloud: costs of the processes of each.
        alone_mb: see `alone_mb`, of the robot's agent.
    """

    case: BenchCase
    seconds: float
    robot: tuple[Cost, ...]
    cloud: tuple[Cost, ...]
    alone_mb: float

    def of(self, side: str) -> tuple[Cost, ...]:
        """Return the costs of one side."""
        return self.robot if side == "robot" else self.cloud

    @property
    def conditions(self) -> str:
        """What the agents were busy with, and for how long."""
        return f"{load(self.case)}, {self.seconds:.0f} s"

    @property
    def messages_per_s(self) -> float:
        """Messages that cross, of all topics: inputs to the cloud and the command to the robot."""
        return len(self.case.sensors) * self.case.sensor_rate_hz + self.case.cloud_rate_hz


def usage(comm: str, stat: str, smaps_rollup: str, smaps: str, *, ticks_per_s: int) -> Usage:
    """Return it from the files of a process in /proc, see proc(5)."""
    fields = stat.rpartition(")")[2].split()
    sizes = _sizes(smaps_rollup)
    return Usage(
        name=comm.strip(),
        cpu_s=(int(fields[11]) + int(fields[12])) / ticks_per_s,  # utime and stime
        pss_bytes=sizes["Pss"],
        anonymous_bytes=sizes["Pss_Anon"],
        file_bytes=_files(smaps),
    )


def _sizes(text: str) -> dict[str, int]:
    """Return lines such as `Pss:   123 kB` in bytes."""
    words = (line.split() for line in text.splitlines())
    return {found[0].rstrip(":"): int(found[1]) * 1024 for found in words if len(found) == 3 and found[2] == "kB"}


def _files(smaps: str) -> dict[str, int]:
    """Return resident bytes of every mapped piece of a file, by file and offset, without copied pages."""
    found: dict[str, int] = {}
    piece = ""
    for line in smaps.splitlines():
        words = line.split()
        if not words[0].endswith(":"):  # a new mapping: addresses, rights, offset, device, inode and path
            piece = f"{words[5]}@{words[2]}" if len(words) > 5 and words[5].startswith("/") else ""
        elif piece and words[0] in ("Rss:", "Anonymous:"):
            sign = 1 if words[0] == "Rss:" else -1
            found[piece] = found.get(piece, 0) + sign * int(words[1]) * 1024
    return found


def costs(before: Sequence[Usage], after: Sequence[Usage], seconds: float) -> tuple[Cost, ...]:
    """Return per process; both lists are of the same processes in the same order."""
    return tuple(
        Cost(_process(late.name), (late.cpu_s - early.cpu_s) / seconds * 100, late.pss_bytes / MB)
        for early, late in zip(before, after, strict=True)
    )


def _process(name: str) -> str:
    """Return the agent's process behind a name of ps, which the kernel cuts off after 15 characters."""
    short = name.removeprefix("ro-robot-").removeprefix("ro-cloud-")
    return next((process for process in PROCESSES if process.startswith(short)), "supervisor")


def alone_mb(usages: Sequence[Usage]) -> float:
    """Return what the same processes would hold with no other program on the machine to share files with.

    Anonymous pages are shared only within the agent (it forks), so their proportional parts add up. Of each file the
    most that one process holds is taken.
    """
    files: dict[str, int] = {}
    for usage in usages:
        for name, held in usage.file_bytes.items():
            files[name] = max(files.get(name, 0), held)
    return (sum(usage.anonymous_bytes for usage in usages) + sum(files.values())) / MB


def outcome(
    priority: Priority, whole: Weighed, single: Weighed, earlier: Weighed | None = None, against: str = ""
) -> GroupResult:
    """Return the figures of one observation.

    Args:
        priority: of agents and nodes.
        whole: with all topics.
        single: with one topic alone, which shows what each further one costs.
        earlier: agents of another commit, with all topics.
        against: that commit.
    """
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(*_totals(whole, earlier, against), *_each(whole, single)),
        parts=(),
        samples=tuple(
            {"case": name, **asdict(cost)}
            for name, weighed in (("whole", whole), ("single", single), (against, earlier))
            if weighed is not None
            for cost in (*weighed.robot, *weighed.cloud)
        ),
    )


def _totals(whole: Weighed, earlier: Weighed | None, against: str) -> Iterator[Figure]:
    """Yield processor time and memory of each side; limits are demanded of the robot's agent."""
    alone = f"; {whole.alone_mb:.0f} MB with no other program on the machine to share libraries with"
    for side in ("robot", "cloud"):
        found, before = whole.of(side), earlier.of(side) if earlier else ()
        cpu = Figure(
            f"cpu_{side}", f"Processor time of the {side}'s agent, all processes", whole.conditions, None, len(found),
            _cpu(found), "% of a core", note=_shares(found, "cpu_percent"),
            baseline=_cpu(before) if before else None, against=against,
        )  # fmt: skip
        pss = Figure(
            f"pss_{side}", f"Memory of the {side}'s agent, all processes (PSS)", whole.conditions, None, len(found),
            _pss(found), "MB", note=_shares(found, "pss_mb"),
            baseline=_pss(before) if before else None, against=against,
        )  # fmt: skip
        if side == "robot":
            cpu = replace(cpu, must=CPU_MUST, aim=CPU_AIM)
            pss = replace(pss, must=PSS_MUST_MB, aim=PSS_AIM_MB, note=pss.note + alone)
        yield from (cpu, pss)


def _each(whole: Weighed, single: Weighed) -> Iterator[Figure]:
    cpu, messages = _cpu(whole.robot), whole.messages_per_s
    yield Figure(
        "cpu_message", "Processor time of the robot's agent for each message", whole.conditions, None, 1,
        cpu / 100 / messages * 1e6, "µs", note="everything that it does, shared out among the messages that cross",
    )  # fmt: skip
    topics, further = len(whole.case.sensors), len(whole.case.sensors) - len(single.case.sensors)
    topic = (cpu - _cpu(single.robot)) / further
    without = cpu - topics * topic
    yield Figure(
        "cpu_topic", "Processor time of the robot's agent for each further topic", whole.conditions, None, further,
        topic, "% of a core",
        note=f"{topic / 100 / whole.case.sensor_rate_hz * 1e6:.0f} µs a message; {without:.1f} % without any",
    )  # fmt: skip


def _cpu(costs: Sequence[Cost]) -> float:
    return sum(cost.cpu_percent for cost in costs)


def _pss(costs: Sequence[Cost]) -> float:
    return sum(cost.pss_mb for cost in costs)


def _shares(costs: Sequence[Cost], field: str) -> str:
    return ", ".join(f"{cost.name} {getattr(cost, field):.1f}" for cost in costs)


def load(case: BenchCase) -> str:
    """Return what the agent was busy with."""
    rates = sorted({case.sensor_rate_hz, case.cloud_rate_hz, case.robot_rate_hz})
    shown = " and ".join(f"{rate:g}" for rate in rates)
    topics = "1 topic" if len(case.sensors) == 1 else f"{len(case.sensors)} topics"
    return f"{topics} to the cloud and the command at {shown} Hz, beats at 50 Hz"
