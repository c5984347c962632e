"""Which side the collector passes, for the data and relay processes."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Site, Token


@dataclass(frozen=True)
class Holding:
    """The side that holds, from the collector's memory.

    Attributes:
        site: the side that the collector passes; the robot also before the first gate and after falling back.
        stay: grows by one with each change of `site`, over restarts of collector and control.
        token: token under which that side passes; epoch 0 before the first gate.
    """

    site: Site
    stay: int
    token: Token
