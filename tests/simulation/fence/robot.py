"""The robot's control as an adversary, and all that it has said and that may still be under way.

The network needs no choice of what is sent: whatever may be said is said, and each word and grant may arrive at any
moment while it lives, any number of times, in any order, or never. That is the same as a network that drops, doubles,
delays and reorders, with room for any number of words.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, replace

from robot_offload_core.fence import grant
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.grant import Grant
from robot_offload_core.fence.token import Site, Token
from tests.simulation.fence.bounds import NOW, Bounds


@dataclass(frozen=True)
class Robot:
    """The grant, and what was said before with its age since it could last be said."""

    number: int
    grant: Grant
    said: frozenset[tuple[Hashable, int]]


class RobotPart:
    """Steps of the robot's control.

    Attributes:
        speech: what control can say in a state, as the other part hears it, and up to which age that may matter; -1:
            only while it is said.
    """

    def __init__(self, bounds: Bounds, speech: Callable[[Robot], dict[Hashable, int]]) -> None:
        self.bounds = bounds
        self.speech = speech
        self.longest: dict[Hashable, int] = {}

    def start(self) -> Robot:
        """Return control at its first start: no lease is left of anything before."""
        return Robot(0, grant.start("robot0", NOW - self.bounds.stopped, self.bounds.stopped), frozenset())

    def tick(self, robot: Robot) -> Robot:
        """Return the robot one tick later."""
        said = frozenset((word, age + 1) for word, age in robot.said if age < self.longest[word])
        clear_s = max(robot.grant.clear_s - 1, NOW)
        return Robot(robot.number, replace(robot.grant, clear_s=clear_s), said)

    def moves(self, robot: Robot) -> Iterator[tuple[str, Robot]]:
        """Yield what control may do by itself at any moment: whatever decides above the fence is an adversary."""
        now, stopped = robot.grant, self.bounds.stopped
        if now.last_epoch < self.bounds.epochs:
            for number in range(self.bounds.clouds):
                yield f"control prepares for cloud{number}", self._after(robot, grant.prepare(now, f"cloud{number}"))
            yield "control takes over", self._after(robot, grant.take_over(now, NOW, stopped))
        if now.last_epoch < self.bounds.epochs or now.site is Site.CLOUD:
            yield "control calls off", self._after(robot, grant.call_off(now, NOW, stopped))
        yield "control offers", self._after(robot, grant.offer(now))
        if robot.number + 1 < self.bounds.robots:
            number = robot.number + 1
            yield "control restarts", self._after(robot, grant.start(f"robot{number}", NOW, stopped), number)

    def reported(self, robot: Robot, charge: Charge) -> tuple[str, Robot]:
        """Return what control makes of a report of the gate."""
        after = grant.entered(robot.grant, charge, NOW, self.bounds.stopped)
        return f"control hears that the gate passes {shown(charge)}", self._after(robot, after)

    def any_report(self, robot: Robot) -> Iterator[tuple[str, Robot]]:
        """Yield what control makes of whatever a gate might report."""
        for epoch in range(robot.grant.epoch + 1, robot.grant.last_epoch + 1):
            for side in Site:
                yield self.reported(robot, Charge(side, Token(robot.grant.robot, epoch, robot.grant.cloud)))

    def under_way(self, robot: Robot) -> dict[Hashable, int]:
        """Return what may still arrive, with its age."""
        return dict(robot.said) | dict.fromkeys(self._words(robot), 0)

    def _words(self, robot: Robot) -> dict[Hashable, int]:
        words = self.speech(robot)
        self.longest.update(words)
        return words

    def _after(self, robot: Robot, after: Grant, number: int | None = None) -> Robot:
        """Return the robot with another grant; what it could say until now stays under way."""
        if after == robot.grant:
            return robot
        following = Robot(robot.number if number is None else number, after, frozenset())
        now = self._words(following)  # what is still said has no age
        kept = ((w, a) for w, a in self.under_way(robot).items() if w not in now and self.longest[w] >= 0)
        return replace(following, said=frozenset(kept))


def shown(charge: Charge | None) -> str:
    """Return a charge for people."""
    return "nobody" if charge is None else f"{charge.site.value} {charge.token.robot[-1:]}.{charge.token.epoch}"
