"""A world that several tests share, and the rule that there is only one world at a time."""

from collections.abc import Iterator
from typing import ClassVar

from tests.ros.agent.harness import Plan, World


class Shared:
    """Built when it is first needed, and anew when a test has left it unusable.

    A world costs half a core while nothing happens in it, so the one before is closed first.
    """

    present: ClassVar["Shared | None"] = None

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.world: World | None = None

    def get(self) -> World:
        """A world in order, with the cloud in charge."""
        if Shared.present is not self:
            Shared.close_present()
        Shared.present = self
        if self.world is not None:
            try:
                self.world.restore()
                return self.world
            except AssertionError:
                self.close()
        self.world = World(self.plan)
        self.world.__enter__()
        return self.world.start()

    def close(self) -> None:
        if self.world is not None:
            world, self.world = self.world, None
            world.close()

    @classmethod
    def close_present(cls) -> None:
        """Makes room."""
        if cls.present is not None:
            cls.present.close()
            cls.present = None


def judged(shared: Shared) -> Iterator[World]:
    """For fixtures: the world in order, and the rules at the consumer checked after the test."""
    world = shared.get()
    since = len(world.arrivals)
    yield world
    world.check(since)
