"""How large the explored worlds are."""

from __future__ import annotations

from dataclasses import dataclass

NOW = 100
"""The tick that it always is: times are kept as ages."""


@dataclass(frozen=True)
class Bounds:
    """Sizes of a world. Durations in ticks; all ages beyond the largest bound are alike, so a world is finite.

    Attributes:
        epochs: used by each incarnation of the robot's control.
        lease, age, silence: of a grant, of the oldest message that passes, of control at the gate.
        vouch: how long the pulse may repeat a permission that control no longer gives.
        robots, clouds: incarnations of the two control processes: one more than restarts.
    """

    epochs: int = 3
    lease: int = 2
    age: int = 1
    silence: int = 2
    vouch: int = 1
    robots: int = 2
    clouds: int = 2

    @property
    def stopped(self) -> int:
        """After how long a cloud that is permitted nothing has stopped for sure."""
        return self.vouch + self.lease

    @property
    def oldest(self) -> int:
        """The largest age of a time that is told apart from larger ones."""
        return max(self.silence, self.age) + 1
