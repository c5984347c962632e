"""What is free on this machine: loopback ports and ROS domains that no other run uses."""

from __future__ import annotations

import atexit
import itertools
import random
import socket
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from robot_offload.errors import InputError, RobotOffloadError

HOST: Final = "127.0.0.1"
HIGHEST_DOMAIN: Final = 232
"""The last ROS domain whose ports (7400 + 250 * domain) exist."""
_DOMAINS: Final = range(215, 232)
"""The domains whose ports (7400 + 250 * domain) lie above Linux's ephemeral ones (32768 to 60999)."""
_PORTS_PER_DOMAIN: Final = 250
_PORTS: Final = range(20_000, 32_000)
"""Below the ephemeral ports, so that no program gets ours by chance between our check and the agents' start."""


def free_ports() -> tuple[tuple[int, int], tuple[int, int]]:
    """Return two pairs of loopback ports that no program uses, neither with UDP nor with TCP.

    Raises:
        RobotOffloadError: there are too few.
    """
    found: list[int] = []
    with ExitStack() as stack:
        for port in random.sample(_PORTS, len(_PORTS)):
            if _is_free(port, stack):
                found.append(port)
            if len(found) == 4:
                return (found[0], found[1]), (found[2], found[3])
    raise RobotOffloadError(f"of the ports {_PORTS.start} to {_PORTS.stop - 1} fewer than four are free")


def _is_free(port: int, stack: ExitStack) -> bool:
    """Return whether both protocols can be bound; `stack` keeps the sockets until all ports are found."""
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        sock = stack.enter_context(socket.socket(socket.AF_INET, kind))
        try:
            sock.bind((HOST, port))
        except OSError:
            return False
    return True


def free_domains() -> tuple[int, int]:
    """Return two ROS domains that no process of this machine uses, and reserve them while this process lives.

    Raises:
        RobotOffloadError: there are none.
    """
    used = {(port - 7400) // _PORTS_PER_DOMAIN for port in _bound_udp_ports()}
    free = (domain for domain in random.sample(_DOMAINS, len(_DOMAINS)) if domain not in used and _claim(domain))
    found = tuple(itertools.islice(free, 2))
    if len(found) < 2:
        raise RobotOffloadError(
            f"of the ROS domains {_DOMAINS.start} to {_DOMAINS.stop - 1} fewer than two are free; end other runs, or "
            "give two with --domains"
        )
    return found[0], found[1]


_claims: dict[int, socket.socket] = {}
"""Domains of this process. Without this claim a run that has not opened its ports yet would be overlooked."""


def _claim(domain: int) -> bool:
    """Claim a domain; return False if another process has done so. An abstract name ends with its process."""
    if domain not in _claims:
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            sock.bind(f"\0robot-offload-domain-{domain}")
        except OSError:
            sock.close()
            return False
        _claims[domain] = sock
        atexit.register(sock.close)
    return True


def _bound_udp_ports() -> Iterable[int]:
    for table in ("udp", "udp6"):
        path = Path("/proc/net") / table
        for line in path.read_text().splitlines()[1:] if path.exists() else ():
            yield int(line.split()[1].rpartition(":")[2], 16)


def parse_domains(text: str) -> tuple[int, int] | None:
    """Read the option `--domains ROBOT/CLOUD`; return None for an empty text.

    Raises:
        InputError: the text is not two different ROS domains.
    """
    if not text:
        return None
    numbers = [int(part) for part in text.split("/") if part.isdecimal()]
    if len(numbers) != 2 or max(numbers) > HIGHEST_DOMAIN or numbers[0] == numbers[1]:
        raise InputError(
            f"--domains: {text!r}: write two different numbers from 0 to {HIGHEST_DOMAIN}, for example 61/62"
        )
    return numbers[0], numbers[1]
