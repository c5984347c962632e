"""Two network namespaces joined by a bridge in a third one: a DDS link that can be cut without either end noticing.

Taking a port out of the bridge loses every packet silently, as a radio does; setting an interface down would tell the
sockets. Needs root.
"""

import subprocess
import uuid
from typing import Self

ADDRESSES = {"robot": "10.77.0.1/24", "cloud": "10.77.0.2/24"}


class Namespaces:
    """The two ends and the middle, with names of their own per instance."""

    def __init__(self) -> None:
        self.key = uuid.uuid4().hex[:6]
        self.made: list[str] = []

    def name(self, side: str) -> str:
        return f"ro-{side}-{self.key}"

    def make(self) -> None:
        middle = self.name("middle")
        for name in (middle, *map(self.name, ADDRESSES)):
            ip("netns", "add", name)
            self.made.append(name)
            ip("-n", name, "link", "set", "lo", "up")
        ip("-n", middle, "link", "add", "bridge", "type", "bridge")
        ip("-n", middle, "link", "set", "bridge", "type", "bridge", "mcast_snooping", "0")
        ip("-n", middle, "link", "set", "bridge", "up")
        for side, address in ADDRESSES.items():
            end = self.name(side)
            ip("-n", end, "link", "add", "link0", "type", "veth", "peer", "name", side, "netns", middle)
            ip("-n", end, "address", "add", address, "dev", "link0")
            ip("-n", end, "link", "set", "link0", "up")
            ip("-n", end, "route", "add", "224.0.0.0/4", "dev", "link0")
            ip("-n", middle, "link", "set", side, "master", "bridge", "up")

    def cut(self, which: str | None) -> None:
        """`both`, or None to heal; the bridge knows no single direction."""
        assert which in (None, "both")
        if which is None:
            ip("-n", self.name("middle"), "link", "set", "robot", "master", "bridge")
        else:
            ip("-n", self.name("middle"), "link", "set", "robot", "nomaster")

    def remove(self) -> None:
        for name in self.made:
            ip("netns", "delete", name)
        self.made.clear()


class OtherHost:
    """A network namespace joined to the test's own, for a second agent that must not be on the same host."""

    HERE, THERE = "10.78.0.1", "10.78.0.2"

    def __init__(self) -> None:
        self.name = f"ro-other-{uuid.uuid4().hex[:6]}"

    def __enter__(self) -> Self:
        end = self.name[-9:]
        ip("netns", "add", self.name)
        ip("link", "add", end, "type", "veth", "peer", "name", "link0", "netns", self.name)
        ip("address", "add", f"{self.HERE}/24", "dev", end)
        ip("link", "set", end, "up")
        ip("-n", self.name, "address", "add", f"{self.THERE}/24", "dev", "link0")
        for device in ("link0", "lo"):
            ip("-n", self.name, "link", "set", device, "up")
        ip("-n", self.name, "route", "add", "224.0.0.0/4", "dev", "link0")
        return self

    def __exit__(self, *_: object) -> None:
        ip("netns", "delete", self.name)


def ip(*arguments: str) -> None:
    """Runs `ip`; raises CalledProcessError with what it said."""
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)
