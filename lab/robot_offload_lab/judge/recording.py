"""What a recorder at the consumer saw of one run: one JSON object per line, written while the run goes on.

The first line describes the run (`kind: run`); the others come in any order, by time within each kind. All times
are seconds of one host's steady clock (CLOCK_BOOTTIME); the report counts from `RunInfo.start_s`. Reading and
writing of lines is pure; `read` and `RecordingWriter` are the only ones that touch files.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TextIO, TypeAlias

from robot_offload.errors import RecordingError
from robot_offload_lab.judge.lines import Lines, Record

if TYPE_CHECKING:
    from robot_offload.api.v1alpha1 import RobotOffloadSpec

Site: TypeAlias = Literal["robot", "cloud"]
SITES: Final[tuple[Site, Site]] = ("robot", "cloud")


@dataclass(frozen=True)
class RunInfo(Record):
    """The run's setting. Always the first line.

    Attributes:
        mode: what was run, e.g. `offload`, `robot-only`, `cloud-only`.
        seed: seed of everything random in the run.
        start_s: steady clock at the moment that the report calls 0.
        max_command_age_ms, loss_timeout_ms, activation_deadline_ms: `spec.switching` of the run.
        robot_period_ms, cloud_period_ms: `spec.switching.latency` of the run.
        threshold_ms: loop latency up to which the cloud is worth it; a link below it is called good.
        corridor_length_m, corridor_width_m: of the drive: x runs from 0 to the length, y = 0 is the middle line;
            0 when there is no account of a drive.
        silent: outputs that may be silent: those of `unrated`, and those that are judged only at times.
        unrated: outputs that are published only on occasion.
        walls: of the drive, seen from above: x and y of both ends; empty: a corridor.
    """

    mode: str
    seed: int
    start_s: float
    max_command_age_ms: float
    loss_timeout_ms: float
    activation_deadline_ms: float
    robot_period_ms: float
    cloud_period_ms: float
    threshold_ms: float
    corridor_length_m: float = 0.0
    corridor_width_m: float = 0.0
    silent: tuple[str, ...] = ()
    unrated: tuple[str, ...] = ()
    walls: tuple[tuple[float, float, float, float], ...] = ()


def of_run(spec: RobotOffloadSpec, mode: str, seed: int, start_s: float) -> RunInfo:
    """Return the setting of a run of this specification; the other arguments as in `RunInfo`."""
    switching = spec.switching
    return RunInfo(
        mode=mode,
        seed=seed,
        start_s=start_s,
        max_command_age_ms=float(switching.max_command_age_ms),
        loss_timeout_ms=float(switching.loss_timeout_ms),
        activation_deadline_ms=float(switching.activation_deadline_ms),
        robot_period_ms=float(switching.latency.robot_period_ms),
        cloud_period_ms=float(switching.latency.cloud_period_ms),
        threshold_ms=float(switching.latency.allowed_loop_ms),
        silent=silent_at_times(spec),
        unrated=unrated(spec),
    )


def unrated(spec: RobotOffloadSpec) -> tuple[str, ...]:
    """Return the outputs that are published only on occasion."""
    return tuple(output.topic for _, output in spec.collected_outputs if output.rate_hz is None)


def silent_at_times(spec: RobotOffloadSpec) -> tuple[str, ...]:
    """Return the outputs that may be silent: without a rate, or judged only while something is done."""
    outputs = [output for _, output in spec.collected_outputs]
    return tuple(output.topic for output in outputs if output.rate_hz is None or output.while_ is not None)


@dataclass(frozen=True)
class Arrival(Record):
    """One message of a collected output as the consumer received it.

    Attributes:
        topic: the public topic.
        t_s: when it arrived.
        producer: the replica that made it, e.g. `remote_controller`.
        sequence: the replica's number for it, increasing by one.
        sent_t_s: when the replica published it.
        site: the side of that replica.
        passed_t_s: when it was published on the public topic, as the middleware stamped it; None: not known.
        named: the message itself states producer, sequence and time; else the recorder has filled in its own.
    """

    topic: str
    t_s: float
    producer: str
    sequence: int
    sent_t_s: float
    site: Site
    passed_t_s: float | None = None
    named: bool = True

    @property
    def age_s(self) -> float:
        """The age when the message passed to the consumers, or, if unknown, when it arrived."""
        return (self.t_s if self.passed_t_s is None else self.passed_t_s) - self.sent_t_s


@dataclass(frozen=True)
class PlacementChange(Record):
    """The placement as announced; the first one is the state at the start, not a switch.

    Attributes:
        t_s: when it was announced.
        site: the side in charge from now on.
        epoch: increases with every changeover.
        reason: one word, e.g. `HeartbeatLost`.
        message: a sentence for people.
        detect_ms: from the last good heartbeat to the decision; None when the switch was commanded.
        phase: of the placement machine, e.g. `ToRobot`.
        since_s: since when the side is in charge, according to the robot's control process; None: not known.
        control: the incarnation of that control process; epochs of different ones cannot be compared.
    """

    t_s: float
    site: Site
    epoch: int
    reason: str
    message: str = ""
    detect_ms: float | None = None
    phase: str = ""
    since_s: float | None = None
    control: str = ""

    @property
    def decided_s(self) -> float:
        """Since when the side is in charge, or, if the announcement lacks that, when it was announced."""
        return self.t_s if self.since_s is None else self.since_s


@dataclass(frozen=True)
class LinkSample(Record):
    """The link at a moment, by its schedule: the round trip of a packet sent then; None = cut."""

    t_s: float
    rtt_ms: float | None


@dataclass(frozen=True)
class NetworkStatus(Record):
    """An agent's own verdict about the link (`/network_status`, `/remote_network_status`)."""

    t_s: float
    side: Site
    up: bool


@dataclass(frozen=True)
class Inhibit(Record):
    """The driver was inhibited (held at standstill because a core node was not active) or released."""

    t_s: float
    inhibited: bool


@dataclass(frozen=True)
class PathPoint(Record):
    """Where the robot was."""

    t_s: float
    x_m: float
    y_m: float
    speed_mps: float


@dataclass(frozen=True)
class Obstacle(Record):
    """A round obstacle that the robot has seen."""

    x_m: float
    y_m: float
    radius_m: float


@dataclass(frozen=True)
class Errand(Record):
    """A goal of an action, as its client on the robot knows it.

    Attributes:
        t_s: when the client reported it; it repeats that several times a second.
        goal: its number, from 1.
        ending: succeeded, canceled, aborted, rejected; empty while it is under way.
        accepted_ms: how long its acceptance took; None while it is not accepted.
        feedback: messages so far.
        servers: how many times a replica began or continued it.
        backwards: feedback messages out of order so far.
        silence_ms: longest silence of its feedback since the client's previous report.
        results: how many arrived.
        x_m, y_m: position estimated by the replica that drives; None: not reported.
    """

    t_s: float
    goal: int
    ending: str
    accepted_ms: float | None
    feedback: int
    servers: int
    backwards: int
    silence_ms: float
    results: int
    x_m: float | None = None
    y_m: float | None = None


@dataclass(frozen=True)
class Calls(Record):
    """A client's service calls on the robot so far: answered with success, without it, and not at all."""

    t_s: float
    asked: int
    answered: int
    failed: int
    unanswered: int
    longest_ms: float


@dataclass(frozen=True)
class Restored(Record):
    """The state with which the acting replica of a node began.

    Attributes:
        node: the replica, e.g. `remote_localiser`.
        site: its side.
        age_s: age of that state when the replica took it; None: the replica began clean.
        made_s: when the replica reported it, before the message reached us at `t_s`; None: not known.
    """

    t_s: float
    node: str
    site: Site
    age_s: float | None
    made_s: float | None = None


@dataclass(frozen=True)
class Ending(Record):
    """How the run ended; what comes later is not judged. Without an account of the drive there is only `t_s`.

    Attributes:
        t_s: the end of the run.
        collisions: of the robot with walls or obstacles.
        stops: standstills forced by the driver's time-out or the inhibit service.
        goal_reached: whether the robot is at its goal.
    """

    t_s: float
    collisions: int | None = None
    stops: int | None = None
    goal_reached: bool | None = None


_KINDS: Final[Mapping[str, type[Record]]] = {
    "run": RunInfo,
    "arrival": Arrival,
    "placement": PlacementChange,
    "link": LinkSample,
    "status": NetworkStatus,
    "inhibit": Inhibit,
    "path": PathPoint,
    "obstacle": Obstacle,
    "goal": Errand,
    "calls": Calls,
    "restored": Restored,
    "outcome": Ending,
}
LINES: Final = Lines(_KINDS)
"""How the records of a run are written and read."""


@dataclass(frozen=True)
class Recording:
    """A whole run. Every sequence is in the order of time.

    Attributes:
        outputs: arrivals by topic.
        outcome: None when the recorder was stopped before the run's end.
    """

    run: RunInfo
    outputs: Mapping[str, tuple[Arrival, ...]] = field(default_factory=dict)
    placements: tuple[PlacementChange, ...] = ()
    link: tuple[LinkSample, ...] = ()
    network_status: tuple[NetworkStatus, ...] = ()
    inhibits: tuple[Inhibit, ...] = ()
    path: tuple[PathPoint, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    goals: tuple[Errand, ...] = ()
    calls: tuple[Calls, ...] = ()
    restored: tuple[Restored, ...] = ()
    outcome: Ending | None = None

    @property
    def end_s(self) -> float:
        """The end of the run, or the time of the last record."""
        if self.outcome is not None:
            return self.outcome.t_s
        seen = [arrival.t_s for arrivals in self.outputs.values() for arrival in arrivals]
        seen += [change.t_s for change in self.placements]
        seen += [sample.t_s for sample in self.link]
        seen += [point.t_s for point in self.path]
        return max(seen, default=self.run.start_s)


def parse(lines: Iterable[str], source: str) -> Recording:
    """Return a recording from its lines. An unfinished last line (the recorder was killed) is ignored.

    Raises:
        RecordingError: names `source` and the line.
    """
    records: list[Record] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            records.append(LINES.decode(line))
        except ValueError as error:
            if not line.endswith("\n"):
                break
            raise RecordingError(f"{source}:{number}: the line {error}") from error
    return assemble(records, source)


def assemble(records: Iterable[Record], source: str = "recording") -> Recording:
    """Return a recording from single records, sorted by time.

    Raises:
        RecordingError: the run's own record does not come first, or comes twice.
    """
    by_kind: dict[type, list[Any]] = {kind: [] for kind in _KINDS.values()}
    for record in records:
        if not by_kind[RunInfo] and not isinstance(record, RunInfo):
            raise RecordingError(f"{source}: the first line must be of kind run; is this a recording of a run?")
        by_kind[type(record)].append(record)
    if len(by_kind[RunInfo]) != 1:
        raise RecordingError(f"{source}: holds {len(by_kind[RunInfo])} runs; one recording is one run")
    for kind, found in by_kind.items():
        if kind not in (RunInfo, Obstacle):
            found.sort(key=lambda record: record.t_s)
    topics = dict.fromkeys(arrival.topic for arrival in by_kind[Arrival])
    return Recording(
        run=by_kind[RunInfo][0],
        outputs={topic: tuple(a for a in by_kind[Arrival] if a.topic == topic) for topic in topics},
        placements=tuple(by_kind[PlacementChange]),
        link=tuple(by_kind[LinkSample]),
        network_status=tuple(by_kind[NetworkStatus]),
        inhibits=tuple(by_kind[Inhibit]),
        path=tuple(by_kind[PathPoint]),
        obstacles=tuple(dict.fromkeys(by_kind[Obstacle])),
        goals=tuple(by_kind[Errand]),
        calls=tuple(by_kind[Calls]),
        restored=tuple(by_kind[Restored]),
        outcome=by_kind[Ending][-1] if by_kind[Ending] else None,
    )


def read(path: Path) -> Recording:
    """Return the recording in a file.

    Raises:
        RecordingError: the file cannot be read or is not a recording.
    """
    try:
        with path.open(encoding="utf-8") as lines:
            return parse(lines, str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: cannot be read: {error}") from error


class RecordingWriter:
    """Appends records to a stream, a line each, so that a killed recorder leaves everything it received."""

    def __init__(self, stream: TextIO, run: RunInfo) -> None:
        self._stream = stream
        self.write(run)

    def write(self, record: Record) -> None:
        """Append one record and hand it to the operating system."""
        self._stream.write(LINES.encode(record) + "\n")
        self._stream.flush()
