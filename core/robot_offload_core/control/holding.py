"""Outputs that have to speak only while something holds: which of them do now."""

from __future__ import annotations

from collections.abc import Collection

from robot_offload_core.words.settings import OutputSpec


def holding(outputs: tuple[OutputSpec, ...], executing: Collection[str], flowing: Collection[int]) -> tuple[int, ...]:
    """Returns the outputs, by index, whose `while` is true on a side.

    Args:
        outputs: from the configuration.
        executing: actions of which a goal is executed there.
        flowing: outputs, by index, whose `while.topic` arrives there.
    """
    return tuple(
        i
        for i, o in enumerate(outputs)
        if o.while_ is not None and (i in flowing or any(name in executing for name in o.while_.actions))
    )


RELAY_SILENT_S = 0.35
"""A relay reports ten times a second: after so long without a report nobody knows what it executes."""
