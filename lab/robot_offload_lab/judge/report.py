"""From a recording to `report.json`, a self-contained `report.html` and `run.png`.

`build` and `html` are pure; `write` is the shell around them. Scripts may rely on the keys of report.json: keys are
only added, and `schema` changes when one changes its meaning. Times are seconds from the start of the run.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import jinja2

from robot_offload_lab.judge import drawing, handed
from robot_offload_lab.judge import report_figures as figures
from robot_offload_lab.judge.busy import UNKNOWN, Computer, busy, counted
from robot_offload_lab.judge.invariants import Violation, violations
from robot_offload_lab.judge.measures import Measures, Switch, measure, median_period_ms
from robot_offload_lab.judge.recording import SITES, Recording
from robot_offload_lab.judge.streams import Stream, quantile
from robot_offload_lab.judge.untried import untried

SCHEMA: Final = "robotoffload.dev/report/v1"


@dataclass(frozen=True)
class ReportFiles:
    """Where the parts of a report were written."""

    json: Path
    html: Path
    png: Path


def write(
    recording: Recording,
    directory: Path,
    processor: Mapping[str, float] | None = None,
    computer: Computer = UNKNOWN,
    warnings: Sequence[Mapping[str, str]] = (),
) -> ReportFiles:
    """Write `report.json`, `report.html` and `run.png` into `directory`, which is made if needed.

    Args:
        recording: of the run.
        directory: where to write.
        processor: share of one core that each program used, percent.
        computer: what it did during the run.
        warnings: what the agents reported: side, reason, message, advice.

    Raises:
        OSError: the files cannot be written.
    """
    measures = measure(recording)
    report = build(measures, processor, computer, warnings)
    directory.mkdir(parents=True, exist_ok=True)
    files = ReportFiles(directory / "report.json", directory / "report.html", directory / "run.png")
    files.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    files.html.write_text(html(report, measures), encoding="utf-8")
    files.png.write_bytes(drawing.png(figures.run(measures)))
    return files


def build(
    measures: Measures,
    processor: Mapping[str, float] | None = None,
    computer: Computer = UNKNOWN,
    warnings: Sequence[Mapping[str, str]] = (),
) -> dict[str, Any]:
    """Return the report as plain values, ready for JSON; the arguments as in `write`."""
    recording = measures.recording
    why_busy, found = busy(recording, computer), violations(measures)
    kept = counted(found, why_busy)
    outcome = recording.outcome
    return {
        "schema": SCHEMA,
        "mode": recording.run.mode,
        "duration_s": _round(measures.duration_s),
        "seed": recording.run.seed,
        "switches": [_switch(switch, recording) for switch in measures.switches],
        "outputs": {
            topic: _output(stream) | {"rated": topic not in recording.run.unrated}
            for topic, stream in measures.streams.items()
        },
        "collisions": outcome.collisions if outcome else None,
        "stops": outcome.stops if outcome else None,
        "goal_reached": outcome.goal_reached if outcome else None,
        "placement_share": {site: _round(share, 4) for site, share in measures.placement_share.items()},
        "cloud_share_of_good_time": _round(measures.cloud_share_of_good_time, 4),
        "messages_passed": {site: measures.messages_passed[site] for site in SITES},
        "detector_alarms": measures.alarms,
        "false_alarms": measures.false_alarms,
        "link": _link(measures),
        "goals": [_goal(figures, recording) for figures in handed.goals(recording)],
        "calls": _calls(recording),
        "state": [_taking(taking, recording) for taking in handed.takings(recording)],
        "processor": dict(processor or {}),
        "warnings": [dict(warning) for warning in warnings],
        "busy": why_busy,
        "violations": [_violation(violation) for violation in kept],
        "excused": [_violation(violation) for violation in found if violation not in kept],
    }


def html(report: Mapping[str, Any], measures: Measures) -> str:
    """Return the report as one HTML page without references to anything outside."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = _number
    environment.filters["known"] = lambda count: "not known" if count is None else count
    pictures = [
        ("Link and placement", drawing.svg(figures.link_and_placement(measures))),
        ("Silence of the outputs at each switch", drawing.svg(figures.gaps_per_switch(measures))),
    ]
    if measures.recording.path:
        pictures.append(("The way through the corridor", drawing.svg(figures.path(measures))))
    return environment.get_template("report.html.j2").render(
        report=report, pictures=pictures, sites=SITES, untried=tuple(untried(report))
    )


def _switch(switch: Switch, recording: Recording) -> dict[str, Any]:
    return {
        "t_s": _round(switch.t_s - recording.run.start_s),
        "from": switch.before,
        "to": switch.after,
        "reason": switch.change.reason,
        "message": switch.change.message,
        "epoch": switch.change.epoch,
        "detect_ms": _round(switch.change.detect_ms),
        "gap_ms": {topic: _round(gap) for topic, gap in switch.gap_ms.items()},
        "lost": switch.lost,
        "duplicates": switch.duplicates,
    }


def _output(stream: Stream) -> dict[str, Any]:
    lengths = [gap.length_ms for gap in stream.gaps if gap.after is not None]
    return {
        "period_ms": _round(median_period_ms(stream)),
        "received": len(stream.arrivals),
        "duplicates": len(stream.duplicates) if stream.known else None,
        "reordered": len(stream.reordered) if stream.known else None,
        "stale": len(stream.stale) if stream.known else None,
        "lost": stream.lost if stream.known else None,
        "gap_ms": {
            "p50": _round(quantile(lengths, 0.5)),
            "p99": _round(quantile(lengths, 0.99)),
            "max": _round(max(lengths, default=None)),
        },
    }


def _link(measures: Measures) -> dict[str, Any]:
    latencies = [sample.rtt_ms for sample in measures.recording.link if sample.rtt_ms is not None]
    return {
        "threshold_ms": _round(measures.recording.run.threshold_ms),
        "good_s": _round(measures.good_s),
        "outages": len(measures.outages),
        "outage_s": _round(sum(interval.length_s for interval in measures.outages)),
        "rtt_ms": {
            "p50": _round(quantile(latencies, 0.5)),
            "p99": _round(quantile(latencies, 0.99)),
            "max": _round(max(latencies, default=None)),
        },
    }


def _goal(figures: handed.GoalFigures, recording: Recording) -> dict[str, Any]:
    last = figures.last
    return {
        "goal": figures.goal,
        "ending": figures.ending,
        "t_s": _round(figures.until_s - recording.run.start_s),
        "results": last.results,
        "accepted_ms": _round(last.accepted_ms),
        "restarts": figures.restarts,
        "feedback": last.feedback,
        "backwards": last.backwards,
        "silence_ms": _round(figures.silence_ms),
        "error_m": _round(figures.error_m),
    }


def _calls(recording: Recording) -> dict[str, Any] | None:
    last = handed.calls(recording)
    if last is None:
        return None
    counts = {name: getattr(last, name) for name in ("asked", "answered", "failed", "unanswered")}
    return {**counts, "longest_ms": _round(last.longest_ms)}


def _taking(taking: handed.Taking, recording: Recording) -> dict[str, Any]:
    age_s = taking.restored.age_s
    return {
        "t_s": _round(taking.change.t_s - recording.run.start_s),
        "node": taking.restored.node,
        "age_ms": None if age_s is None else _round(age_s * 1e3),
    }


def _violation(violation: Violation) -> dict[str, Any]:
    return {"t_s": _round(violation.t_s), "kind": violation.kind, "text": violation.text}


def _round(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else round(value, digits)


def _number(value: float | None, digits: int = 1) -> str:
    """Return a figure for people; a dash where there is none."""
    return "\N{EN DASH}" if value is None else f"{value:.{digits}f}"
