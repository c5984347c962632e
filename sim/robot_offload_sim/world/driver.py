"""The wheels: their own dead-man time-out, and the inhibit service on top of it."""

from __future__ import annotations

from robot_offload_sim.world.world import Act, Host, Process, World

DEAD_MAN_S = 0.3
"""Command time-out of the driver."""


class Driver(Process):
    """The driver of the wheels.

    Attributes:
        inhibited: as last requested; a restart forgets it.
        command_s: true time of the last command.
        released_s: true time of the last release.
        slow_s: delay that faults add to each service call.
    """

    def __init__(self, world: World, host: Host) -> None:
        super().__init__(world, host, "robot/driver")
        self.inhibited = False
        self.command_s = -1.0
        self.released_s = -1.0
        self.slow_s = 0.0

    def boot(self) -> None:
        """Start as a new process without a command: the dead man holds it until the first one."""
        self.inhibited = False
        self.command_s = -1.0

    def command(self) -> None:
        """Take a command that reached the wheels."""
        if self.alive:
            self.command_s = self.world.now

    def may_move(self) -> bool:
        """Return whether it is neither inhibited nor held by the dead man."""
        return self.alive and not self.inhibited and self.world.now - self.command_s <= DEAD_MAN_S

    def inhibit(self, value: bool, client: Process, answered: Act) -> None:
        """Serve the request; `answered(value)` happens at the client."""
        delay_s = 0.0003 + self.world.dice.random() * 0.003 + self.slow_s
        self.world.after(delay_s, self.deliver, self._inhibit, value, client, answered)

    def _inhibit(self, value: bool, client: Process, answered: Act) -> None:
        if value is not self.inhibited:
            self.world.note("driver inhibited" if value else "driver released")
            self.released_s = self.world.now
        self.inhibited = value
        client.post(self.name, answered, value)
