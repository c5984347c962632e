"""The names of all objects that a RobotOffload gets in the cluster. Every name comes from `child_name`.

A name must fit a label (63 characters) and a Service (a letter first). What does not fit is cut and gets a hash of
the whole, so that two long names stay two, and the same input gives the same name for ever.
"""

from __future__ import annotations

import hashlib
import re
from typing import Final

MAX_LENGTH: Final = 63
MAX_STATEFUL_LENGTH: Final = 52
"""Of a StatefulSet: Kubernetes adds a dash and ten characters, and makes a label of it."""
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
"""Not plain `parameters`: that is what people call their own ConfigMap."""
_OWN_WORDS: Final = frozenset(
    (
        BUILD,
        IMAGES,
        PARAMETERS.replace("-", "_"),
        AGENT,
        SETTINGS,
        DDS,
        ROUTER,
        NODES,
        DISCOVERY,
        UDP,
        TCP,
        ROBOT,
        CLOUD,
    )
)
_OWN_BEGINNINGS: Final = (f"{DISCOVERY}_", f"{BUILD}_")
_PLAIN_NODE: Final = re.compile(r"[a-z0-9]+(_+[a-z0-9]+)*")


def child_name(offload: str, *parts: str, limit: int = MAX_LENGTH) -> str:
    """The name of a child: `wheelchair-7`, `agent` -> `wheelchair-7-agent`.

    Args:
        offload: the RobotOffload's name.
        parts: what is added, joined by dashes.
        limit: characters at most.
    """
    name = "-".join((offload, *parts))
    if len(name) <= limit and _FITS.fullmatch(name):
        return name
    # The parts are hashed one by one, so that `a` + `b-c` and `a-b` + `c` differ once they are cut.
    digest = _digest("\0".join((offload, *parts)))
    readable = name if name[0].isalpha() else f"r-{name}"
    return f"{readable[: limit - _HASH_LENGTH - 1].rstrip('-')}-{digest}"


def node_child(offload: str, node: str) -> str:
    """The name of a node's Deployment: `wheelchair-7`, `map_server` -> `wheelchair-7-map-server`.

    Names of nodes may hold capitals and end with underscores, those of objects may not. Whatever is not lower case
    with underscores inside, or is the name of a child of our own, gets a hash of the node's name; so no two nodes
    of a RobotOffload ever meet in one Deployment.
    """
    plain = node.lower().strip("_").replace("_", "-")
    if _PLAIN_NODE.fullmatch(node) and node not in _OWN_WORDS and not node.startswith(_OWN_BEGINNINGS):
        return child_name(offload, plain)
    return child_name(offload, plain or "node", _digest(node))


def discovery_child(offload: str, server: int) -> str:
    """The name of the StatefulSet and the Service of a discovery server."""
    return child_name(offload, DISCOVERY, str(server), limit=MAX_STATEFUL_LENGTH)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_LENGTH]
