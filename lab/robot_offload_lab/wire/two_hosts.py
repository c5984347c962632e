"""Two hosts on one machine: network namespaces joined by nothing but the emulated link. Needs root and `ip`.

Both get a tunnel device, whose packets this process takes from one and gives to the other when the model of the link
says so: the same model, options and control socket as the wire of the agents' sessions (`local.wire`). All that passes
between the two hosts is subject to it: discovery, acknowledgements and data of DDS.

Nothing stays: the namespaces have no names. They live as long as this process or one that has entered them by
`robot_namespace` or `cloud_namespace`.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, Self, cast

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.wire.emulated import EmulatedWire
from robot_offload_lab.wire.link import Direction, EmulatedLink
from robot_offload_lab.wire.loop import READ, Loop, steady_s
from robot_offload_lab.wire.options import Forward, LinkOptions, WireConfig
from robot_offload_lab.wire.process import WireProcess, WireProcessError
from robot_offload_lab.wire.udp import UdpForward

ROBOT_ADDRESS: Final = "10.79.0.1"
CLOUD_ADDRESS: Final = "10.79.0.2"
DEVICE: Final = "wire0"
MULTICAST: Final = "224.0.0.0/4"
_NAMESPACES: Final = {"robot": 701, "cloud": 702}
"""File descriptors under which this process keeps them, so that others can enter them through /proc."""
_TUNSETIFF: Final = 0x400454CA
_IFF_TUN: Final = 0x0001
_IFF_NO_PI: Final = 0x1000
_LARGEST: Final = 65535
_BURST: Final = 64


class TwoHosts(EmulatedWire):
    """The process as a context manager, with the controls of a wire."""

    MODULE = "robot_offload_lab.wire.two_hosts"

    def __init__(self, link: LinkOptions, seed: int) -> None:
        """Prepare; start nothing.

        Args:
            link: what the link between the hosts does.
            seed: seed of its random draws.
        """
        unused = Forward("unused", "udp", "127.0.0.1:0", "127.0.0.1:9")  # a wire has at least one
        super().__init__(WireConfig(forwards=(unused,), link=link, seed=seed, realtime=True))

    @classmethod
    def refusal(cls) -> str:
        """Return why this machine cannot make two hosts; empty when it can."""
        if os.geteuid() != 0:
            return "network namespaces need root"
        if not Path("/dev/net/tun").exists():
            return "there is no /dev/net/tun"
        return ""

    def namespace(self, host: str) -> str:
        """Return the file through which the network namespace of `robot` or `cloud` can be entered."""
        return f"/proc/{self.pid}/fd/{_NAMESPACES[host]}"

    def enter(self, host: str) -> tuple[str, ...]:
        """Return the prefix of a command that runs it on a host."""
        return ("nsenter", f"--net={self.namespace(host)}", "--")


class _End:
    """One host's tunnel device. It is a file, not a socket, but the loop only needs its descriptor."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def fileno(self) -> int:
        return self._descriptor

    def watch(self, loop: Loop, action: Callable[[int], None]) -> None:
        loop.watch(cast(socket.socket, self), READ, action)

    def read(self) -> bytes | None:
        """Return the next packet that the host sends; None when there is none."""
        try:
            return os.read(self._descriptor, _LARGEST)
        except OSError:
            return None

    def write(self, packet: bytes) -> None:
        """Give a packet to the host."""
        with contextlib.suppress(OSError):
            os.write(self._descriptor, packet)

    def close(self) -> None:
        os.close(self._descriptor)


class Tunnel:
    """Both devices; takes the place of a forwarded port in the wire's process."""

    port = 0
    clients = 2

    def __init__(self, loop: Loop, link: EmulatedLink) -> None:
        self._loop = loop
        self._link = link
        self._robot, self._cloud = _host("robot", ROBOT_ADDRESS), _host("cloud", CLOUD_ADDRESS)
        self._robot.watch(loop, lambda _: self._carry("up", self._robot, self._cloud))
        self._cloud.watch(loop, lambda _: self._carry("down", self._cloud, self._robot))

    def _carry(self, direction: Direction, source: _End, target: _End) -> None:
        for _ in range(_BURST):
            packet = source.read()
            if packet is None:
                return
            arrives_s = self._link.datagram(direction, steady_s(), len(packet))
            if arrives_s is not None:
                self._loop.call_at(arrives_s, lambda packet=packet: target.write(packet))  # type: ignore[misc]

    def forget_idle(self, _now_s: float) -> None:
        """Do nothing: nothing is remembered here."""

    def close(self) -> None:
        """Close the devices; the namespaces end with the process."""
        self._robot.close()
        self._cloud.close()

    @classmethod
    def open(cls, loop: Loop, link: EmulatedLink) -> Self:
        """Make both hosts.

        Raises:
            WireProcessError: this machine does not permit it.
        """
        with Path("/proc/self/ns/net").open(encoding="ascii") as home:
            try:
                return cls(loop, link)
            except (OSError, subprocess.CalledProcessError) as error:
                raise WireProcessError(f"no network namespaces can be made: {error}; run as root") from error
            finally:
                os.setns(home.fileno(), os.CLONE_NEWNET)


def _host(name: str, address: str) -> _End:
    """Make a network namespace with loopback and a device that leads to this process. This thread stays in it."""
    other = CLOUD_ADDRESS if address == ROBOT_ADDRESS else ROBOT_ADDRESS
    os.unshare(os.CLONE_NEWNET)
    with Path("/proc/self/ns/net").open(encoding="ascii") as own:
        os.dup2(own.fileno(), _NAMESPACES[name], inheritable=False)
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack("16sH22x", DEVICE.encode(), _IFF_TUN | _IFF_NO_PI))
    for words in (
        "link set lo up",
        f"addr add {address} peer {other} dev {DEVICE}",
        f"link set dev {DEVICE} up multicast on",
        f"route add {MULTICAST} dev {DEVICE}",
    ):
        subprocess.run(["ip", *words.split()], check=True, capture_output=True)
    return _End(descriptor)


class TwoHostsProcess(WireProcess):
    """The wire's process with the tunnel in front of its ports."""

    def _open(self, stack: ExitStack) -> None:
        tunnel = Tunnel.open(self._loop, self._link)
        stack.callback(tunnel.close)
        self._forwards["hosts"] = cast(UdpForward, tunnel)
        super()._open(stack)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGTERM or SIGINT; 1 if it cannot start."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.wire.two_hosts", description=__doc__)
    parser.add_argument("--config", type=Path, required=True, help="JSON file, see WireConfig")
    parser.add_argument("--parent", type=int, help="stop when this process is no longer the parent")
    options = parser.parse_args(arguments)
    try:
        config = WireConfig.from_json(options.config.read_text(encoding="utf-8"))
        TwoHostsProcess(config, parent=options.parent).run()
    except RobotOffloadError as error:
        sys.stderr.write("\n".join(error.lines) + "\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
