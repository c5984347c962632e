"""Outputs that have to speak only while something holds: which of them do now."""

from __future__ import annotations

from collections.abc import Collection

from robot_offload_core.words.settings import OutputSpec


def holding(outputs: tuple[OutputSpec, ...], executing: Collection[str], flowing: Collection[int]) -> tuple[int, ...]:
    """Return the outputs, by index, whose `while` is true on a side.

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


RELAY_UNHEARD_S = 0.35
"""After this long without a report (three are missing) nothing is known of what a relay executes, so its outputs
with `while`
are not judged. Shorter than RELAY_GONE_S: not judging an output costs nothing."""
