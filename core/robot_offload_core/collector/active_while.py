"""When a rated output must publish: always, or only while a condition (`while`) is true.

The executing side reports its condition, control passes it on with the gate, and each side is judged by its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_offload_core.fence.token import Site
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.replace import replace

if TYPE_CHECKING:
    from robot_offload_core.collector.state import OutputState


def note(outputs: tuple[OutputState, ...], gate: Gate, now_s: float) -> tuple[OutputState, ...]:
    """Record since when the `while` of each output is true on each side."""

    def since(before_s: float | None, holds: bool) -> float | None:
        return (now_s if before_s is None else before_s) if holds else None

    return tuple(
        o if o.spec.while_ is None else replace(
            o, robot_while_s=since(o.robot_while_s, i in gate.robot_while),
            cloud_while_s=since(o.cloud_while_s, i in gate.cloud_while),
        )
        for i, o in enumerate(outputs)
    )  # fmt: skip


def awaited(output: OutputState, site: Site) -> bool:
    """Return whether a changeover to a side waits for the side's first message of an output.

    It waits for rated outputs; for those with a `while` only while that is true on the side. It does not wait for a
    node that calls names outside the group: its calls are admitted, so that it can publish, only after the changeover.
    """
    spec = output.spec
    since_s = output.robot_while_s if site is Site.ROBOT else output.cloud_while_s
    return spec.rated and not spec.waits and (spec.while_ is None or since_s is not None)


def must_speak(output: OutputState, side: Site, activation_s: float, now_s: float) -> bool:
    """Return whether silence of a rated output is a fault of a side now.

    With a `while` it is one while that is true, from the output's first message since then, or after the time in which
    a node becomes Active.
    """
    if output.spec.while_ is None:
        return True
    robot = side is Site.ROBOT
    since_s = output.robot_while_s if robot else output.cloud_while_s
    heard_s = output.robot_s if robot else output.cloud_s
    if since_s is None:
        return False
    return (heard_s is not None and heard_s >= since_s) or now_s >= since_s + activation_s
