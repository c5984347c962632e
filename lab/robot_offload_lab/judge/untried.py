"""What a run without a broken promise does not prove, because it was not tried or not measured. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from robot_offload_lab.judge.invariants import OFFLOAD


def untried(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each promise about which a run without a violation proves nothing."""
    if report["busy"]:
        yield f"{report['busy']}; {_excused(report['excused'])}. Close other programs, or run it on a faster one"
    for topic, output in report["outputs"].items():
        if output["received"] and output["lost"] is None:
            yield f"{topic}: duplicates, losses and age are not known; its messages carry no number of ours"
    if report["mode"] == OFFLOAD and not report["placement_share"].get("cloud"):
        yield "The cloud never acted, so no change of the side was tried"
    for goal in report["goals"]:
        if not goal["results"]:
            yield f"Goal {goal['goal']} had no result when the run ended ({goal['ending']})"


def _excused(excused: Sequence[Mapping[str, Any]]) -> str:
    if not excused:
        return "every promise was kept all the same"
    kinds = ", ".join(sorted({violation["kind"] for violation in excused}))
    return f"{len(excused)} that it explains {'is' if len(excused) == 1 else 'are'} left out ({kinds})"
