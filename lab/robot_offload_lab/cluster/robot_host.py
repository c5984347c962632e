"""Machines that are not nodes: a robot behind a wire and NAT, or a neighbour in the cluster's own network."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypedDict, Unpack

from robot_offload_lab.cluster import netns, network, processes
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import MOST_NODES, Layout
from robot_offload_lab.cluster.wire import RobotWire

# A machine's programs are ours, but it has its own: shared memory, by which DDS participants on one machine find each
# other; no name server; /run; and what is written to /etc and /var/lib, which survives a power cut.
_OWN = """set -e
mount -t tmpfs -o mode=1777 tmpfs /dev/shm
mount -t tmpfs tmpfs /run
for place in etc var/lib; do
  mkdir -p "$0/$place/own" "$0/$place/work"
  mount -t overlay -o "lowerdir=/$place,upperdir=$0/$place/own,workdir=$0/$place/work" overlay "/$place"
done
rm -f /etc/resolv.conf
: > /etc/resolv.conf
echo ready
exec sleep infinity
"""


_FACTS = "host.json"


class Bonds(TypedDict):
    """What ties a machine to its cluster."""

    die_with_us: bool
    """Its programs end with the thread that starts them."""

    gone: Callable[[str], None]
    """Called with its name when it has been removed."""


class RobotHost(ABC):
    """A machine of its own outside the cluster.

    Attributes:
        name: Name of the machine.
        index: Determines its addresses.
        address: Its own address, not visible beyond a NAT gateway.
        wire: Its link.
    """

    def __init__(self, layout: Layout, name: str, index: int, **bonds: Unpack[Bonds]) -> None:
        if not re.fullmatch(r"[a-z0-9][a-z0-9-]{0,19}", name):
            raise ClusterError(f"{name!r} is not a valid name of a machine: use up to 20 of a-z, 0-9 and -")
        self.name = name
        self.index = index
        self.address = ""
        self._layout = layout
        self._die_with_us = bonds["die_with_us"]
        self._gone = bonds["gone"]
        self._turn = 0
        self._own: subprocess.Popen[bytes] | None = None
        self.wire = RobotWire(self._control)

    @property
    def netns(self) -> str:
        """Its network namespace."""
        return self._layout.netns(f"robot-{self.name}")

    @property
    def _control(self) -> Path:
        return self._layout.home / "wires" / self.name / "control.sock"

    @property
    def _wires(self) -> str:
        return self._layout.netns("wires")

    @property
    def _near(self) -> str:
        return f"w{self.index}robot"

    @property
    def _far(self) -> str:
        return f"w{self.index}cloud"

    def start(
        self,
        argv: Sequence[str],
        env: Mapping[str, str] | None = None,
        log: Path | None = None,
        *,
        cwd: Path | None = None,
        piped: bool = False,
        priority: int = 0,
    ) -> subprocess.Popen[bytes]:
        """Start a program on this machine. It ends with the thread that called this, or by `Program.kill`.

        Args:
            argv: Program and arguments.
            env: Its whole environment; ours when left out. Proxies are removed: a robot has none.
            log: stdout and stderr are appended to it; otherwise both are lost.
            cwd: Its working directory.
            piped: Its standard input and output are pipes to us; only stderr goes to the log.
            priority: Under SCHED_FIFO, 0 for a normal process; where that is not permitted it runs as a normal one.

        Returns:
            The process; its pid is the program's own, so signals reach the program.
        """
        bond = processes.bond(self._die_with_us)
        inside = [*netns.into(self.netns), f"--mount=/proc/{self._files().pid}/ns/mnt", f"--wd={cwd or Path.cwd()}"]
        pipe = subprocess.PIPE if piped else None
        with (log or Path(os.devnull)).open("ab") as output:
            child = subprocess.Popen(
                [*bond, *inside, *argv],
                env=processes.without_proxies(os.environ if env is None else env),
                stdin=pipe or subprocess.DEVNULL,
                stdout=pipe or output,
                stderr=output,
                start_new_session=True,
            )
        if priority:
            # Its threads will inherit it; right after the start it has none yet.
            with suppress(PermissionError, ProcessLookupError):
                os.sched_setscheduler(child.pid, os.SCHED_FIFO, os.sched_param(priority))
        return child

    def _files(self) -> subprocess.Popen[bytes]:
        """Return the process that keeps this machine's own files mounted; start it again after a power cut."""
        if self._own is None or self._own.poll() is not None:
            bond = processes.bond(self._die_with_us)
            private = ["unshare", "--mount", "--propagation", "private", "sh", "-c", _OWN]
            disk = self._layout.home / "robots" / self.name
            disk.mkdir(parents=True, exist_ok=True)
            log = disk / "files.log"
            with log.open("wb") as output:
                self._own = subprocess.Popen(
                    [*bond, *netns.into(self.netns), *private, str(disk)],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=output,
                    start_new_session=True,
                )
            assert self._own.stdout is not None
            with self._own.stdout as words:
                if words.readline() != b"ready\n":
                    raise ClusterError(f"The machine {self.name} gets no files of its own: {log.read_text().strip()}")
        return self._own

    def run(self, *argv: str) -> str:
        """Run a short command in its network, but with our files, and return the output.

        Raises:
            ClusterError: It failed.
        """
        return netns.run(*argv, netns=self.netns)

    def power_off(self) -> int:
        """Kill every process on it at once; return how many there were. The next `start` is a cold boot."""
        there = netns.empty(self.netns)
        if self._own is not None:
            self._own.wait()
        return there

    @abstractmethod
    def build(self, *, realtime: bool) -> None:
        """Make it.

        Args:
            realtime: Its wire runs with real-time priority.
        """

    @abstractmethod
    def change_address(self) -> str:
        """Give it another address, as when it changes the access point; return the new one."""

    @abstractmethod
    def block_udp(self, block: bool) -> None:
        """Block UDP, as some firewalls do, or let it pass again."""

    def remove(self) -> None:
        """Remove it with everything that runs on it."""
        netns.remove(self.netns)
        if self._own is not None:
            self._own.wait()
        shutil.rmtree(self._layout.home / "robots" / self.name, ignore_errors=True)
        self.wire.stop()
        for each in (self._near, self._far):
            with suppress(ClusterError):  # it may have gone with its other end
                netns.ip(f"link del {each}", netns=self._wires)
        shutil.rmtree(self._control.parent, ignore_errors=True)
        self._gone(self.name)

    def reap(self) -> None:
        """Wait for its helpers, which have been killed."""
        self.wire.reap()
        if self._own is not None:
            self._own.wait()

    def _lay_wire(self, far: str, far_name: str, *, realtime: bool) -> None:
        """Connect it: its eth0 - wire - an interface in another namespace."""
        netns.make(self.netns)
        # One frame is one packet: otherwise the kernel passes 64 kB of a stream at once, and one loss becomes 40.
        single = "gso_max_segs 1"
        netns.ip(
            f"link add {self._near} type veth peer name eth0 {single} netns {self.netns}",
            f"link add {self._far} type veth peer name {far_name} {single} netns {far}",
            f"link set {self._near} up",
            f"link set {self._far} up",
            netns=self._wires,
        )
        self._control.parent.mkdir(parents=True, exist_ok=True)
        self.wire = RobotWire.start(
            self._control, self._wires, self._near, self._far, realtime=realtime, die_with_us=self._die_with_us
        )

    def _take_address(self, address: str, *routes: str) -> None:
        """Change to an address of a /24 network, and with it everything that depends on it."""
        old = [f"addr del {self.address}/24 dev eth0"] if self.address else ["link set eth0 up"]
        netns.ip(*old, f"addr add {address}/24 dev eth0", *routes, netns=self.netns)
        self.address = address
        facts = {"kind": type(self).__name__, "index": self.index, "turn": self._turn, "address": address}
        (self._control.parent / _FACTS).write_text(json.dumps(facts))

    def recall(self, facts: Mapping[str, Any]) -> None:
        """Read what another process has recorded about it."""
        self.address, self._turn = facts["address"], facts["turn"]


class NatRobot(RobotHost):
    """A robot behind NAT: it reaches load balancer addresses and node ports, but cannot be reached."""

    def build(self, *, realtime: bool) -> None:
        """Make it with its gateway and its wire."""
        netns.make(self.gateway, forwards=True)
        self._lay_wire(self.gateway, "lan", realtime=realtime)
        net, port = self._layout.netns("net"), f"gw{self.index}"
        netns.ip(f"link add {port} type veth peer name wan netns {self.gateway}", netns=net)
        netns.ip(f"link set {port} master {network.OUTSIDE} up", netns=net)
        netns.ip(f"addr add {self._inside(1)}/24 dev lan", "link set lan up", netns=self.gateway)
        netns.nft(self._rules(), self.gateway)
        self._move(0)

    @property
    def gateway(self) -> str:
        """The network namespace of its NAT gateway."""
        return self._layout.netns(f"nat-{self.name}")

    @property
    def outer_address(self) -> str:
        """The address that the cluster sees in place of its own."""
        return self._layout.gateway(self.index, self._turn)

    def change_address(self) -> str:
        """Give it and its gateway other addresses; the gateway loses its connections. Return the robot's address."""
        self._move(self._turn + 1)
        return self.address

    def block_udp(self, block: bool) -> None:
        """Block UDP at its gateway, both ways, or let it pass again."""
        rule = "add rule ip gateway blocked meta l4proto udp drop\n" if block else ""
        netns.nft(f"flush chain ip gateway blocked\n{rule}", self.gateway)

    def remove(self) -> None:
        """Remove it with its gateway."""
        super().remove()
        netns.remove(self.gateway)

    def _inside(self, last: int) -> str:
        return f"192.168.{self.index}.{last}"

    def _move(self, turn: int) -> None:
        old = [f"addr del {self.outer_address}/24 dev wan"] if self.address else ["link set wan up"]
        self._turn = turn
        way = f"route add {self._layout.everything} via {self._layout.outside}"
        netns.ip(*old, f"addr add {self.outer_address}/24 dev wan", way, netns=self.gateway)
        self._take_address(self._inside(10 + turn % 2), f"route add default via {self._inside(1)}")
        netns.run("conntrack", "--flush", netns=self.gateway)

    def _rules(self) -> str:
        layout = self._layout
        nodes = f"{{ {layout.node(1)}-{layout.node(MOST_NODES)} }}"
        return f"""
table ip gateway {{
  chain blocked {{ }}
  chain forward {{
    type filter hook forward priority filter; policy drop
    jump blocked
    ct state established,related accept
    iifname lan ip daddr {layout.balancers} accept
    iifname lan ip daddr {nodes} meta l4proto {{ tcp, udp }} th dport 30000-32767 accept
  }}
  chain input {{
    type filter hook input priority filter; policy drop
    ct state established,related accept
    iifname lan accept
  }}
  chain translate {{
    type nat hook postrouting priority srcnat
    oifname wan masquerade
  }}
}}
"""


class Neighbour(RobotHost):
    """A machine in the cluster's network, with a wire but without NAT: it reaches pods and pods reach it."""

    def build(self, *, realtime: bool) -> None:
        """Make it with its wire."""
        net, port = self._layout.netns("net"), f"nb{self.index}"
        self._lay_wire(net, port, realtime=realtime)
        netns.ip(f"link set {port} master {network.LAN} up", netns=net)
        self._move(0)

    def change_address(self) -> str:
        """Give it another address in the same network; return it."""
        self._move(self._turn + 1)
        return self.address

    def block_udp(self, block: bool) -> None:
        """Block UDP to and from it, or let it pass again."""
        rules = "add table inet blocked\ndelete table inet blocked\n"
        if block:
            chains = (
                f"chain {hook} {{ type filter hook {hook} priority 0; meta l4proto udp drop\n}}"
                for hook in ("input", "output")
            )
            rules += "table inet blocked {\n" + "\n".join(chains) + "\n}\n"
        netns.nft(rules, self.netns)

    def _move(self, turn: int) -> None:
        self._turn = turn
        layout = self._layout
        address = layout.neighbour(self.index + 60 * (turn % 2))
        self._take_address(address, f"route add default via {layout.router}", *layout.pod_routes)


def of(layout: Layout, name: str, **bonds: Unpack[Bonds]) -> RobotHost:
    """Return the machine of this name, made by another process."""
    facts = json.loads((layout.home / "wires" / name / _FACTS).read_text())
    kind = NatRobot if facts["kind"] == NatRobot.__name__ else Neighbour
    host = kind(layout, name, facts["index"], **bonds)
    host.recall(facts)
    return host
