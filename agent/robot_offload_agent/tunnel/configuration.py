"""The file of a tunnel, `tunnel.yaml`: plain YAML, written by the operator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import yaml

from robot_offload_agent.errors import ConfigurationError
from robot_offload_core.fence.token import Site


@dataclass(frozen=True)
class Address:
    """An address to listen on or connect to.

    Attributes:
        host: an IP address without brackets, or a DNS name.
        port: TCP.
    """

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def is_name(self) -> bool:
        """Whether the host name must be resolved."""
        try:
            ip_address(self.host)
        except ValueError:
            return True
        return False


@dataclass(frozen=True)
class TunnelConfiguration:
    """What one end of the tunnel does.

    Attributes:
        side: the robot's end dials the cloud's end; the cloud's end waits for it.
        listen: where this end waits: for the router on the robot, for the other end in the cloud.
        connect: where this end connects to: the cloud's addresses on the robot, the router in the cloud.
        ca: PEM file of the authority of the other side.
        certificate: PEM file of this side's certificate.
        private_key: PEM file of its key.
        verify_name: whether the robot checks that the cloud's certificate names the host that it dials.
        peer_name: the common name that the other side's certificate must carry; empty: any that its authority signed.
        own: folder in which the agent keeps the robot's newest pair, `robot.pem` and `robot.key`; empty: none ever.
        realtime: whether this process asks for real-time priority.
    """

    side: Site
    listen: Address
    connect: tuple[Address, ...]
    ca: str
    certificate: str
    private_key: str
    verify_name: bool = False
    peer_name: str = ""
    own: str = ""
    realtime: bool = False


def read(file: Path) -> TunnelConfiguration:
    """Return the configuration in a file.

    Raises:
        ConfigurationError: the file cannot be read, or its content is not valid.
    """
    try:
        document = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{file}: {error}; write the bundle again") from error
    return parse(document)


def parse(document: Any) -> TunnelConfiguration:
    """Return the configuration in a YAML document.

    Raises:
        ConfigurationError: its content is not valid.
    """
    if not isinstance(document, Mapping):
        raise ConfigurationError("the file is not a mapping of keys to values")
    known = {field.name for field in fields(TunnelConfiguration)}
    if unknown := [str(key) for key in document if key not in known]:
        raise ConfigurationError(f"{', '.join(unknown)}: unknown; known are {', '.join(sorted(known))}")
    side = document.get("side")
    if side not in [site.value for site in Site]:
        raise ConfigurationError(f"side: {side!r} is neither robot nor cloud")
    connect = document.get("connect")
    if not isinstance(connect, list) or not connect:
        raise ConfigurationError("connect: needs a list with at least one HOST:PORT")
    return TunnelConfiguration(
        side=Site(side),
        listen=_address("listen", document.get("listen")),
        connect=tuple(_address("connect", one) for one in connect),
        ca=_text("ca", document.get("ca")),
        certificate=_text("certificate", document.get("certificate")),
        private_key=_text("private_key", document.get("private_key")),
        verify_name=_flag("verify_name", document.get("verify_name", False)),
        peer_name=str(document.get("peer_name", "")),
        own=str(document.get("own", "")),
        realtime=_flag("realtime", document.get("realtime", False)),
    )


def _address(name: str, value: Any) -> Address:
    host, _, port = str(value).rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not isinstance(value, str) or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ConfigurationError(f"{name}: {value!r} is not a valid HOST:PORT with a port from 1 to 65535")
    return Address(host, int(port))


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise ConfigurationError(f"{name}: needs the path of a PEM file")
    return value


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise ConfigurationError(f"{name}: {value!r} is neither true nor false")
    return value
