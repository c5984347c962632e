"""Prints the table of the core's prior: what its rules cost on made-up links of the families not held out.

python -m robot_offload_lab.replay.learn
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from typing import Final

from robot_offload_core.link.experts import SILENT_BEATS
from robot_offload_core.link.prior import MEMORIES, PRIOR
from robot_offload_core.words.settings import Settings
from robot_offload_lab.links.made_up import FAMILIES, made
from robot_offload_lab.replay.costs import Weights
from robot_offload_lab.replay.rent_or_buy import grid
from robot_offload_lab.replay.study import StudiedLink, case

SEEDS: Final = 12
DURATION_S: Final = 1200.0
TOLERANCES: Final = (1.0, 0.7, 1.4)
"""Shares of the family's usual tolerance, by seed: a rule must not rely on a generous one."""
EASY: Final = 2.0
"""Added to both costs, so that uneventful links do not outweigh the others."""


def links(seeds: int, duration_s: float, *, held_out: bool) -> Iterator[StudiedLink]:
    """Yield made-up links of the held-out families, or of the others."""
    for name, family in FAMILIES.items():
        if family.held_out is held_out:
            for seed in range(1, seeds + 1):
                tolerance_s = family.tolerance_s * TOLERANCES[seed % len(TOLERANCES)]
                yield case(made(name, seed, duration_s), Settings(tolerance_s=tolerance_s), Weights())


def costs(subject: StudiedLink) -> list[float]:
    """Return what each rule of the prior costs on a link."""
    silence_s = SILENT_BEATS * subject.settings.beat_period_s
    found: dict[tuple[float, float, float, int], float] = {}
    for (share, memory), rows in itertools.groupby(PRIOR, key=lambda row: (row[0], row[3])):
        pairs = [(out, back) for _, out, back, _, _ in rows]
        rules = grid(
            subject.beats, subject.limit_us, subject.weights, subject.forbidden,
            silences_s=(silence_s,), pairs=pairs, share=share, memory=MEMORIES[memory - 1] if memory else None,
        )  # fmt: skip
        found |= {(share, rule.out, rule.back, memory): rule.cost for rule in rules}
    return [found[share, out, back, memory] for share, out, back, memory, _ in PRIOR]


def learnt(cases: Sequence[StudiedLink] | Iterator[StudiedLink]) -> list[float]:
    """Return the figure of each rule: the mean logarithm of its cost as a multiple of the best fixed rule's."""
    sums, count = [0.0] * len(PRIOR), 0
    for subject in cases:
        best = subject.best_fixed.cost + EASY
        sums = [total + math.log((cost + EASY) / best) for total, cost in zip(sums, costs(subject), strict=True)]
        count += 1
    return [total / count for total in sums]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 0."""
    parser = argparse.ArgumentParser(
        prog="python -m robot_offload_lab.replay.learn", description="The prior of the core."
    )
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--duration", type=float, default=DURATION_S)
    options = parser.parse_args(arguments)
    figures = learnt(links(options.seeds, options.duration, held_out=False))
    for (share, out, back, memory, _), figure in zip(PRIOR, figures, strict=True):
        sys.stdout.write(f"    ({share:g}, {out:g}, {back:g}, {memory}, {figure:.3f}),\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
