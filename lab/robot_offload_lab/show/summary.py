"""The report of a run in a few lines for a terminal. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from robot_offload_lab.judge.untried import untried


def summary(report: Mapping[str, Any], out: Path) -> tuple[str, ...]:
    """Return the most important lines of `report`, and where the rest is."""
    return (
        "",
        f"{report['mode']}, seed {report['seed']}: {_ending(report)}",
        *(f"  {_output(topic, output)}" for topic, output in report["outputs"].items()),
        f"  switches: {_switches(report['switches'], report['outputs'])}",
        *(f"  {line}" for line in _placement(report)),
        *(f"  {line}" for line in _handed(report)),
        *(f"  {line}" for line in _processor(report)),
        *(f"  {line}" for line in _warnings(report)),
        *_verdict(report["violations"], tuple(untried(report))),
        f"Report: {out / 'report.html'} (also report.json, run.png, recording.jsonl, run.mcap, logs)",
    )


def _ending(report: Mapping[str, Any]) -> str:
    parts = [f"{report['duration_s']:.1f} s"]
    if report["goal_reached"] is not None:
        parts.append("goal reached" if report["goal_reached"] else "goal not reached")
        parts.append(_count(report["collisions"], "collision"))
        parts.append(_count(report["stops"], "forced stop"))
    return ", ".join(parts)


def _output(topic: str, output: Mapping[str, Any]) -> str:
    longest = output["gap_ms"]["max"]
    silence = "" if longest is None else f", longest silence {longest:.0f} ms"
    if output["lost"] is None:
        return f"{topic}: {output['received']} received, duplicates, lost and stale not known{silence}"
    return (
        f"{topic}: {output['received']} received, {_count(output['duplicates'], 'duplicate')}, {output['lost']} lost, "
        f"{output['stale']} stale{silence}"
    )


def _switches(switches: Sequence[Mapping[str, Any]], outputs: Mapping[str, Mapping[str, Any]]) -> str:
    if not switches:
        return "none"
    lost = [switch["detect_ms"] for switch in switches if switch["detect_ms"] is not None]
    gaps = [
        gap
        for switch in switches
        for topic, gap in switch["gap_ms"].items()
        if gap is not None and outputs[topic]["rated"]
    ]
    parts = [str(len(switches))]
    if lost:
        parts.append(f"{len(lost)} of them after a loss, noticed within {max(lost):.0f} ms")
    if gaps:
        parts.append(f"silence around them at most {max(gaps):.0f} ms")
    return ", ".join(parts)


def _placement(report: Mapping[str, Any]) -> Iterator[str]:
    if not report["placement_share"]:
        return
    text = f"in the cloud {report['placement_share']['cloud']:.0%} of the time"
    if report["cloud_share_of_good_time"] is not None:
        text += f", {report['cloud_share_of_good_time']:.0%} of the time with a good link"
    yield f"{text}; detector alarms: {report['detector_alarms']}, false: {report['false_alarms']}"


def _handed(report: Mapping[str, Any]) -> Iterator[str]:
    for goal in report["goals"]:
        yield (
            f"goal {goal['goal']}: {goal['ending']}, {_count(goal['results'], 'result')}, {goal['feedback']} feedback "
            f"messages from {_count(goal['restarts'] + 1, 'turn')}, longest silence {goal['silence_ms']:.0f} ms"
        )
    ages_ms = [taking["age_ms"] for taking in report["state"] if taking["age_ms"] is not None]
    if report["state"]:
        oldest = f", at most {max(ages_ms):.0f} ms old" if ages_ms else ""
        yield f"state taken over: {len(ages_ms)} of {_count(len(report['state']), 'time')}{oldest}"
    calls = report["calls"]
    if calls is not None:
        late = f", the longest wait {calls['longest_ms']:.0f} ms" if calls["asked"] else ""
        yield f"calls: {calls['asked']}, answered {calls['answered']}, failed {calls['failed']}{late}"


def _processor(report: Mapping[str, Any]) -> Iterator[str]:
    shares = {name.removeprefix("robot-"): share for name, share in report["processor"].items() if "robot-" in name}
    if shares:
        said = ", ".join(f"{name} {share:.0f} %" for name, share in sorted(shares.items(), key=lambda it: -it[1])[:6])
        yield f"processor on the robot, of one core: {said}"


def _warnings(report: Mapping[str, Any]) -> Iterator[str]:
    for one in report["warnings"]:
        yield f"the {one['side']}'s agent warned of {one['reason']}: {one['message']}"


def _verdict(violations: Sequence[Mapping[str, Any]], untried: Sequence[str]) -> Iterator[str]:
    if not violations:
        yield "No broken promise was seen, but:" if untried else "All promises were kept"
        yield from (f"  {sentence}" for sentence in untried)
        return
    yield f"{_count(len(violations), 'promise')} broken:"
    for violation in violations:
        yield f"  {violation['kind']}: {violation['text']}"


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
