"""Visits every state that a world can reach, breadth first, so that a broken invariant comes with a shortest story.

A world has two parts, the robot's control and one that it speaks to. A state is one integer of two numbers. What a part
does is asked of the world once for each of its states and inputs, so that the kernel's own functions fill the tables.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from tests.simulation.fence.robot import Robot

BITS = 32
MASK = (1 << BITS) - 1


class BrokenError(Exception):
    """An invariant does not hold."""


class World(Protocol):
    """Two parts and their steps; each step has a name. Steps that change nothing are left out by the explorer."""

    def start(self) -> tuple[Robot, Any]:
        """Return the first state of both parts."""

    def robot_tick(self, robot: Robot) -> Robot:
        """Return the robot one tick later."""

    def tick(self, other: Any) -> Any:
        """Return the other part one tick later."""

    def robot_moves(self, robot: Robot) -> Iterator[tuple[str, Robot]]:
        """Yield what the robot may do by itself."""

    def moves(self, other: Any) -> Iterator[tuple[str, Any]]:
        """Yield what the other part may do by itself."""

    def tells(self, other: Any) -> Hashable:
        """Return what the other part tells the robot."""

    def told(self, robot: Robot, said: Any) -> Iterator[tuple[str, Robot]]:
        """Yield the robot after it was told that."""

    def inputs(self, robot: Robot) -> list[Hashable]:
        """Return what may reach the other part while the robot is in this state."""

    def react(self, other: Any, heard: Hashable) -> Iterator[tuple[str, Any]]:
        """Yield the other part after that has reached it."""

    def claims(self, robot: Robot) -> Hashable:
        """Return what the robot's state demands of the other part."""

    def check(self, claims: Any, other: Any) -> None:
        """Raise BrokenError where the other part does not meet that."""


@dataclass(frozen=True)
class Explored:
    """What was found.

    Attributes:
        states, edges: visited; an edge leads to another state.
        complete: every state that can be reached was visited.
        broken: the invariant that does not hold; "" when all do.
        story: the steps that lead there.
    """

    states: int
    edges: int
    complete: bool
    broken: str = ""
    story: tuple[str, ...] = ()


class Numbers:
    """Gives each value a number."""

    def __init__(self) -> None:
        self.of: dict[Hashable, int] = {}
        self.items: list[Any] = []

    def __call__(self, item: Hashable) -> int:
        """Return the number of a value."""
        number = self.of.setdefault(item, len(self.items))
        if number == len(self.items):
            self.items.append(item)
        return number


class Table:
    """What a part does, by numbers: (number after, name) of each step that changes it, asked once per key."""

    def __init__(self, numbers: Numbers, steps: Callable[..., Iterable[tuple[str, Hashable]]], *of: Numbers) -> None:
        self.numbers = numbers
        self.steps = steps
        self.of = of
        self.known: dict[tuple[int, ...], tuple[int, ...]] = {}

    def __call__(self, *key: int) -> tuple[int, ...]:
        """Return the numbers that the part, the first of the key, may change to."""
        found = self.known.get(key)
        if found is None:
            after = dict.fromkeys(self.numbers(part) for _, part in self.named(*key))
            after.pop(key[0], None)
            found = self.known[key] = tuple(after)
        return found

    def named(self, *key: int) -> Iterable[tuple[str, Hashable]]:
        """Yield each step with its name."""
        return self.steps(*(numbers.items[number] for numbers, number in zip(self.of, key, strict=True)))


class Explorer:
    """Breadth first over the product of two parts."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.robots, self.others, self.heard, self.said, self.claims = (Numbers() for _ in range(5))
        robots, others = self.robots, self.others
        self.robot_moves = Table(robots, world.robot_moves, robots)
        self.moves = Table(others, world.moves, others)
        self.told = Table(robots, world.told, robots, self.said)
        self.react = Table(others, world.react, others, self.heard)
        self.checked: set[tuple[int, int]] = set()
        self.of_robot: dict[int, tuple[int, int, tuple[int, ...]]] = {}
        self.of_other: dict[int, tuple[int, int]] = {}

    def run(self, most: int) -> Explored:
        """Visit everything, or stop at so many states or at the first invariant that does not hold."""
        robot, other = self.world.start()
        first = self.robots(robot) << BITS | self.others(other)
        parents, queue, at, edges = {first: first}, [first], 0, 0
        while at < len(queue) < most:
            state = queue[at]
            at += 1
            try:
                for after in self._after(state >> BITS, state & MASK):
                    edges += 1
                    if after not in parents:
                        parents[after] = state
                        queue.append(after)
            except BrokenError as broken:
                return Explored(len(queue), edges, False, str(broken), self._story(parents, state))
        return Explored(len(queue), edges, at == len(queue))

    def _after(self, robot: int, other: int) -> Iterator[int]:
        known = self.of_robot.get(robot) or self._look_at_robot(robot)
        later, claims, inputs = known
        other_later, said = self.of_other.get(other) or self._look_at_other(other)
        if (claims, other) not in self.checked:
            self.world.check(self.claims.items[claims], self.others.items[other])
            self.checked.add((claims, other))
        base = robot << BITS
        yield later << BITS | other_later
        for after in self.robot_moves(robot):
            yield after << BITS | other
        for after in self.told(robot, said):
            yield after << BITS | other
        for after in self.moves(other):
            yield base | after
        react, known_reactions = self.react, self.react.known
        for heard in inputs:
            reactions = known_reactions.get((other, heard))
            for after in react(other, heard) if reactions is None else reactions:
                yield base | after

    def _look_at_robot(self, number: int) -> tuple[int, int, tuple[int, ...]]:
        robot = self.robots.items[number]
        later, claims = self.robots(self.world.robot_tick(robot)), self.claims(self.world.claims(robot))
        found = self.of_robot[number] = later, claims, tuple(map(self.heard, self.world.inputs(robot)))
        return found

    def _look_at_other(self, number: int) -> tuple[int, int]:
        other = self.others.items[number]
        found = self.of_other[number] = self.others(self.world.tick(other)), self.said(self.world.tells(other))
        return found

    # -- for people ---------------------------------------------------------------------------------------------------

    def _story(self, parents: dict[int, int], state: int) -> tuple[str, ...]:
        steps = []
        while parents[state] != state:
            steps.append(self._name(parents[state], state))
            state = parents[state]
        return tuple(reversed(steps))

    def _name(self, before: int, after: int) -> str:
        robot, other = before >> BITS, before & MASK
        if robot == after >> BITS:
            wanted = self.others.items[after & MASK]
            tables = [self.moves.named(other), *(self.react.named(other, h) for h in self.of_robot[robot][2])]
        else:
            wanted = self.robots.items[after >> BITS]
            same = other == after & MASK
            tables = [self.robot_moves.named(robot), self.told.named(robot, self.of_other[other][1])] if same else []
        return next((name for steps in tables for name, part in steps if part == wanted), "a tick passes")


def explore(world: World, most: int = 20_000_000) -> Explored:
    """Explore a world."""
    return Explorer(world).run(most)
