"""The names of all objects that a RobotOffload gets in the cluster. Every name comes from `child_name`.

A name must fit a label (63 characters) and a Service (a letter first). One that does not fit is cut and gets a hash of
the whole, so that two long names stay different, and the same input always gives the same name.
"""

from __future__ import annotations

import hashlib
import re
from typing import Final

MAX_LENGTH: Final = 63
MAX_STATEFUL_LENGTH: Final = 52
"""Of a StatefulSet: Kubernetes adds a dash and ten characters, and makes it a label."""
_HASH_LENGTH: Final = 8
_FITS: Final = re.compile(r"[a-z]([-a-z0-9]*[a-z0-9])?")

AGENT: Final = "agent"
SETTINGS: Final = "settings"
DDS: Final = "dds"
ROUTER: Final = "router"
NODES: Final = "nodes"
DISCOVERY: Final = "discovery"
UDP: Final = "udp"
TCP: Final = "tcp"
ROBOT: Final = "robot"
CLOUD: Final = "cloud"
SERVER_CA: Final = "server-ca"
CLIENT_CA: Final = "client-ca"
BUILD: Final = "build"
IMAGES: Final = "images"
PARAMETERS: Final = "renamed-parameters"
"""Not plain `parameters`, which users call their own ConfigMap."""
_LAST_WORDS: Final = frozenset(
    word.rpartition("-")[2]
    for word in (
        AGENT, SETTINGS, DDS, ROUTER, NODES, DISCOVERY, UDP, TCP, ROBOT, CLOUD, SERVER_CA, CLIENT_CA, BUILD, IMAGES,
        PARAMETERS,
    )
)  # fmt: skip
"""The endings of our own children's names."""
_ONE_WORD: Final = re.compile(r"(?![0-9a-f]{8}$)[a-z][a-z0-9]*")
"""A word that cannot be taken for a hash."""


def child_name(offload: str, *parts: str, limit: int = MAX_LENGTH) -> str:
    """Return the name of a child: `wheelchair-7`, `agent` -> `wheelchair-7-agent`.

    Args:
        offload: the RobotOffload's name.
        parts: added, joined by dashes.
        limit: maximum of characters.
    """
    name = "-".join((offload, *parts))
    if len(name) <= limit and _FITS.fullmatch(name):
        return name
    # The parts are hashed one by one, so that `a` + `b-c` and `a-b` + `c` differ after cutting.
    digest = _digest("\0".join((offload, *parts)))
    readable = name if name[0].isalpha() else f"r-{name}"
    return f"{readable[: limit - _HASH_LENGTH - 1].rstrip('-')}-{digest}"


def node_child(offload: str, node: str) -> str:
    """Return the name of a node's Deployment: `wheelchair-7`, `talker` -> `wheelchair-7-talker`.

    Two RobotOffloads of a namespace must never want one name, whatever their names: `fleet` with node `x_agent` and the
    agent of `fleet-x` would. So only a node whose name is a single word, and not an ending of our own names, keeps it;
    every other one gets a hash of both names.
    """
    plain = node.lower().strip("_").replace("_", "-")
    if _ONE_WORD.fullmatch(node) and node not in _LAST_WORDS:
        return child_name(offload, node)
    return child_name(offload, plain or "node", _digest(f"{offload}\0{node}"))


def discovery_child(offload: str, server: int) -> str:
    """Return the name of the StatefulSet and the Service of a discovery server."""
    return child_name(offload, DISCOVERY, str(server), limit=MAX_STATEFUL_LENGTH)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_LENGTH]
