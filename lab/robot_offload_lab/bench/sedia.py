"""The whole robot: how long the change of its navigation stack takes, and what the robot saves.

    python -m robot_offload_lab.bench.sedia [--out DIR] [--docs]

Runs `examples/sedia` twice: with both sides while the link is cut again and again, and on the robot alone. When nodes
became Active is read from the agents' logs, which have milliseconds; what consumers felt is from the recorder.
"""

from __future__ import annotations

import argparse
import datetime
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.names import Side
from robot_offload_lab.bench import machine
from robot_offload_lab.judge.handed import SUCCEEDED
from robot_offload_lab.judge.streams import quantile
from robot_offload_lab.run.demo import DemoOptions, run
from robot_offload_lab.run.system import Mode
from robot_offload_lab.show.view import LineView, Terminal
from robot_offload_lab.wire.options import LinkOptions

ROOT: Final = Path(__file__).parents[3]
SPEC: Final = ROOT / "examples" / "sedia" / "robotoffload.yaml"
PAGE: Final = ROOT / "examples" / "sedia" / "README.md"
BEGIN: Final = "<!-- figures: written by `make bench-sedia`; changes between these lines are lost -->\n"
END: Final = "<!-- end of the figures -->\n"
COMMANDS: Final = "/cmd_vel_nav"
ROUNDS: Final = 4
"""Of the patrol, so that there is a goal all the time."""
OFFLOAD_S: Final = 120.0
ALONE_S: Final = 60.0
OUTAGE: Final = "3/12"
_LINE: Final = re.compile(r"(\d\d):(\d\d):(\d\d\.\d+) [A-Z]+ (robot|cloud)\.(\w+): (.*)")
_ACTIVE: Final = re.compile(r"Node (\w+): inactive -> active")
_DECIDED: Final = re.compile(r"phase=(Takeover|ToRobot|ToCloud)\b")


@dataclass(frozen=True)
class Changeover:
    """One change of the acting side.

    Attributes:
        to: the side that got to act.
        lost: whether the link was lost, so that the other side could not be asked.
        ready_ms: from the decision until the last node of the group was Active.
    """

    to: Side
    lost: bool
    ready_ms: float


@dataclass(frozen=True)
class _Event:
    t_s: float
    side: Side
    node: str = ""
    phase: str = ""


def changeovers(lines: Iterable[str], nodes: Sequence[str]) -> list[Changeover]:
    """Returns the changes that both agents' logs tell of, those in which every node of the group became Active.

    Args:
        lines: of both logs.
        nodes: the duplicated ones.
    """
    events = sorted(_events(lines), key=lambda event: event.t_s)
    found: list[Changeover] = []
    decided: _Event | None = None
    waking: set[str] = set()
    for event in events:
        if event.phase:
            if decided is None or decided.phase != event.phase or not waking:
                decided, waking = event, set(nodes)
        elif decided is not None and event.side == decided.side and event.node in waking:
            waking.remove(event.node)
            if not waking:
                ready_ms = (event.t_s - decided.t_s) * 1e3
                found.append(Changeover(decided.side, decided.phase == "Takeover", ready_ms))
                decided = None
    return found


def _events(lines: Iterable[str]) -> Iterator[_Event]:
    for line in lines:
        match = _LINE.match(line)
        if match is None:
            continue
        hours, minutes, seconds, logger, part, text = match.groups()
        t_s = int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)
        side: Side = "robot" if logger == "robot" else "cloud"
        if (active := _ACTIVE.match(text)) is not None and part == "process":
            yield _Event(t_s, side, node=active[1])
        elif side == "robot" and part == "robot" and (decided := _DECIDED.search(text)) is not None:
            yield _Event(t_s, "cloud" if decided[1] == "ToCloud" else "robot", phase=decided[1])


def figures(both: Mapping[str, Any], alone: Mapping[str, Any], found: Sequence[Changeover]) -> dict[str, Any]:
    """Returns everything that is measured.

    Args:
        both: report of the run with both sides.
        alone: report of the run on the robot alone.
        found: the changes of the first one.
    """
    gaps = [switch["gap_ms"].get(COMMANDS) for switch in both["switches"]]
    endings = [goal["ending"] for goal in both["goals"]]
    return {
        "to_robot_lost_ms": _spread([it.ready_ms for it in found if it.to == "robot" and it.lost]),
        "to_cloud_ms": _spread([it.ready_ms for it in found if it.to == "cloud"]),
        "command_gap_ms": _spread([gap for gap in gaps if gap is not None]),
        "goals": len(endings),
        "goals_succeeded": endings.count(SUCCEEDED),
        "goals_lost": sum(ending not in (SUCCEEDED, "on the way") for ending in endings),
        "restarts": sum(goal["restarts"] for goal in both["goals"]),
        "cloud_share": both["placement_share"].get("cloud", 0.0),
        "processor": {"offload": both["processor"], "robot-only": alone["processor"]},
    }


def _spread(values: Sequence[float]) -> dict[str, float | None]:
    middle, worst = quantile(values, 0.5), max(values, default=None)
    return {"n": len(values), "p50": None if middle is None else round(middle), "max": worst and round(worst)}


def table(found: Mapping[str, Any], date: str, words: str) -> str:
    """Returns the figures as a piece of a page."""
    rows = [
        ("change to the robot after a loss: decision until the last of six nodes is Active", "to_robot_lost_ms"),
        ("change to the cloud: the same, with goal and state handed over first", "to_cloud_ms"),
        (f"longest silence of `{COMMANDS}` around a change", "command_gap_ms"),
    ]
    text = f"Measured {date} by `make bench-sedia`: {words}.\n\n"
    text += "| | n | median (ms) | longest (ms) |\n|---|---|---|---|\n"
    text += "".join(
        f"| {what} | {found[key]['n']} | {found[key]['p50']} | {found[key]['max']} |\n" for what, key in rows
    )
    text += (
        f"\n{found['goals']} goals were sent, {found['goals_succeeded']} succeeded before the run ended, "
        f"{found['goals_lost']} were lost; other replicas went on with them {found['restarts']} times. The cloud acted "
        f"{found['cloud_share']:.0%} of the time.\n\n"
    )
    offload, alone = found["processor"]["offload"], found["processor"]["robot-only"]
    text += "| program, percent of one core | both sides | robot alone |\n|---|---|---|\n"
    for name in sorted(offload.keys() | alone.keys()):
        if name.startswith(("robot-", "cloud-")):
            text += f"| {name} | {_cell(offload.get(name))} | {_cell(alone.get(name))} |\n"
    return text


def _cell(value: float | None) -> str:
    return "\N{EN DASH}" if value is None else f"{value:.1f}"


def longer(offload: RobotOffload) -> RobotOffload:
    """Returns the resource with a patrol of several rounds."""
    nodes = []
    for node in offload.spec.nodes:
        if node.run is not None and "waypoints" in node.run.parameters:
            waypoints = list(node.run.parameters["waypoints"]) * ROUNDS
            run = node.run.model_copy(update={"parameters": {**node.run.parameters, "waypoints": waypoints}})
            nodes.append(node.model_copy(update={"run": run}))
        else:
            nodes.append(node)
    return offload.model_copy(update={"spec": offload.spec.model_copy(update={"nodes": tuple(nodes)})})


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures, prints the figures and writes `sedia.json`; with `--docs` the example's page as well."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.sedia", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/bench-sedia"), help="folder for reports and logs")
    parser.add_argument("--docs", action="store_true", help="write the figures into the example's page")
    options = parser.parse_args(arguments)
    view = LineView(Terminal(stderr=True))
    link = LinkOptions(delay="5ms", jitter="2ms", loss="1%", outages=(OUTAGE,))
    one = DemoOptions(SPEC, Mode.OFFLOAD, OFFLOAD_S, link, out=options.out / "offload", adapt=longer)
    both = run(one, view)
    alone = run(replace(one, mode=Mode.ROBOT_ONLY, duration_s=ALONE_S, out=options.out / "robot-only"), view)
    logs = [line for side in ("robot", "cloud") for line in _log(options.out / "offload", side)]
    nodes = [node.name for node in load(SPEC).spec.nodes if node.duplicated]
    found = figures(both.report, alone.report, changeovers(logs, nodes))
    found["violations"] = both.report["violations"]
    (options.out / "sedia.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    date = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    text = table(found, date, machine.words(machine.describe()))
    view.say(text)
    if options.docs:
        page = PAGE.read_text(encoding="utf-8")
        head, _, rest = page.partition(BEGIN)
        _, _, tail = rest.partition(END)
        PAGE.write_text(f"{head}{BEGIN}\n{text}\n{END}{tail}", encoding="utf-8")
    return 1 if found["goals_lost"] or both.trouble or alone.trouble else 0


def _log(out: Path, side: Side) -> list[str]:
    return (out / "logs" / f"{side}-agent.log").read_text(errors="replace").splitlines()


if __name__ == "__main__":
    sys.exit(main())
