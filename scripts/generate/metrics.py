"""The reference page of all metrics, from their declarations in the reporter and the operator."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from prometheus_client.core import Metric

from robot_offload.reporter.families import FAMILIES, Family
from robot_offload.runtime.metrics import Metrics

_HEAD: Final = """\
<!-- Generated from reporter/families.py and runtime/metrics.py by `make generate`; changes here are lost. -->
# Metrics

Prometheus reads two kinds of pods: the reporter beside each cloud agent, one a robot, and the operator. Nothing reads a
robot: its own numbers come once a second over the data session (at most 2 kB) and appear here with `side="robot"`, the
cloud's with `side="cloud"`. Names and units follow [Prometheus's conventions](https://prometheus.io/docs/practices/naming/):
base units, counters end in `_total`. How to use them: [dashboards and alerts](../how-to/observe.md).

A counter begins at 0 when the process that counts starts anew; `rate()` and `increase()` know that. What a silent agent
last said is left out instead of repeated, and so are the robot's numbers when none has come for 5 s
(`robot_offload_robot_report` is 0 then). So a gap in a graph means that nobody knows.

*Series* is how many time series one robot adds at most (for a histogram with its buckets). Topics and outputs are those
that are declared, nodes and actions too, reasons are words of ours: nothing that a message holds becomes a label.

## The reporter, one a robot

| metric | type | labels | series | meaning |
|---|---|---|---|---|
"""
_SUM: Final = """
Together at most {total} series a robot.

## The operator

`process_*`, `python_*` and `robot_offload_build_info` are there besides. Series do not grow with the number of robots
but where `name` is a label.

| metric | type | labels | meaning |
|---|---|---|---|
"""


def metrics() -> str:
    """Return the page as Markdown."""
    rows = [_family(family) for family in FAMILIES]
    total = sum(family.series for family in FAMILIES)
    return "\n".join([_HEAD + "\n".join(rows), _SUM.format(total=total) + "\n".join(_operator()), ""])


def _family(family: Family) -> str:
    shown = family.name + ("_total" if family.kind == "counter" else "")
    return f"| `{shown}` | {family.kind} | {_labels(family.labels)} | {family.series} | {family.text} |"


def _operator() -> Iterator[str]:
    """Yield the rows of the operator's own metrics, as an operator without objects declares them."""
    declared = Metrics()
    declared.show(lambda: (), dict, lambda: 0, lambda: 0.0, lambda: False)
    for collector in dict.fromkeys(declared.registry._collector_to_names):
        found: list[Metric] = list(collector.collect())
        names = getattr(collector, "_labelnames", None)
        for metric in found:
            if not metric.name.startswith("robot_offload"):
                continue
            suffix = {"counter": "_total", "info": "_info"}.get(metric.type, "")
            labels = tuple(names if names is not None else getattr(metric, "_labelnames", ()))
            yield f"| `{metric.name}{suffix}` | {metric.type} | {_labels(labels)} | {metric.documentation} |"


def _labels(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "-"
