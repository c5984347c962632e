"""The advice for `robot-offload import --advise`: the best three cuts as a table and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_offload.survey.crossing import size_text
from robot_offload.survey.snapshot import GraphSnapshot
from robot_offload_lab.advise.cuts import best_cuts
from robot_offload_lab.advise.model import Link, Problem
from robot_offload_lab.advise.seen import asked


@dataclass(frozen=True)
class Advised:
    """What is proposed.

    Attributes:
        placements: of the best cut: node -> Duplicated or Cloud.
        lines: a table for people.
        values: the same for programs.
    """

    placements: dict[str, str]
    lines: tuple[str, ...]
    values: list[dict[str, Any]]


def advise(
    graph: GraphSnapshot, *, bandwidth: float, rtt_s: float, tolerance_s: float, speedup: float, picture: Path | None
) -> Advised:
    """Returns the best three cuts of a graph.

    Args:
        graph: what was seen.
        bandwidth: of the link, bytes per second, both ways together.
        rtt_s: of the link, there and back.
        tolerance_s: how much slower a loop through the cloud may be.
        speedup: how much shorter the periods of nodes are in the cloud.
        picture: file for a picture of the cuts (SVG, PNG or PDF by its name); None: none.
    """
    question = asked(graph, Link(bandwidth, rtt_s), tolerance_s, speedup)
    advice = best_cuts(question.problem)
    values = [_values(question.problem, cut) for cut in advice.cuts]
    lines = [
        f"Cuts for {size_text(bandwidth)}/s and {rtt_s * 1e3:g} ms there and back, tolerance {tolerance_s * 1e3:g} ms:"
    ]
    lines += [_line(number, it) for number, it in enumerate(values, 1)]
    if not values:
        lines.append("none: no node can leave the robot within these limits")
    if not advice.proven:
        lines.append("the graph is large: these are the best that were found, better ones may exist")
    if picture is not None and advice.cuts:
        from robot_offload_lab.advise.picture import draw  # noqa: PLC0415 - matplotlib takes a second to load

        draw(question.problem, advice.cuts, picture)
    best = {name: question.placements[name] for name in advice.cuts[0]} if advice.cuts else {}
    return Advised(best, tuple(lines), values)


def _values(problem: Problem, cut: frozenset[str]) -> dict[str, Any]:
    loops = sorted(problem.loops(cut), key=lambda it: it.gained_s - it.link_s)
    worst = loops[0] if loops else None
    return {
        "leave": sorted(cut),
        "saved_cores": round(problem.saved(cut), 4),
        "of_all": round(problem.saved(cut) / (sum(it.cpu for it in problem.parts.values()) or 1.0), 4),
        "bytes_per_s": round(problem.bytes_per_s(cut)),
        "topics": sorted({flow.topic for flow in problem.crossing(cut)}),
        "loop": None if worst is None else {
            "to": worst.topic, "link_ms": round(worst.link_s * 1e3, 2), "gained_ms": round(worst.gained_s * 1e3, 2),
        },
    }  # fmt: skip


def _line(number: int, it: dict[str, Any]) -> str:
    loop = it["loop"]
    rule = ""
    if loop is not None:
        rule = f"; slowest loop to {loop['to']}: {loop['link_ms']:g} ms on the link, {loop['gained_ms']:g} ms gained"
    share = f"{it['saved_cores']:.1%} of a core ({it['of_all']:.0%} of all nodes)"
    return (
        f"{number}. {', '.join(it['leave'])}: saves {share}, "
        f"sends {size_text(it['bytes_per_s'])}/s on {len(it['topics'])} topics{rule}"
    )
