"""Outputs that must publish only while a condition (`while`) is true: which of them must publish now."""

from __future__ import annotations

from collections.abc import Collection

from robot_offload_core.words.settings import OutputSpec


def holding(outputs: tuple[OutputSpec, ...], executing: Collection[str], flowing: Collection[int]) -> tuple[int, ...]:
    """Return the outputs, by index, whose `while` is true on a side.

    Args:
        outputs: from the configuration.
        executing: actions with a goal that is being executed on that side.
        flowing: outputs, by index, whose `while.topic` arrives there.
    """
    return tuple(
        i
        for i, o in enumerate(outputs)
        if o.while_ is not None and (i in flowing or any(name in executing for name in o.while_.actions))
    )


RELAY_UNHEARD_S = 0.35
"""After this long without a report (three are missing) it is unknown what a relay executes, and its outputs with
`while` are not judged. Shorter than RELAY_GONE_S: not judging an output costs nothing."""
