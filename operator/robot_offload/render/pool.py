"""Nodes with several pods: the names by which each pod is called, and the end of one without a lost call.

Each pod serves under private names with its own name in them, which only the pod itself knows: a few lines of Python
put it into the node's arguments. The same text runs in every pod, so nothing that a user wrote is ever run as code.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload.api.v1alpha1 import Node
from robot_offload.kube.port import Manifest
from robot_offload.render import handover
from robot_offload.render.ros_names import THIS_POD

POD_VARIABLE: Final = "ROBOT_OFFLOAD_POD"
URL_VARIABLE: Final = "ROBOT_OFFLOAD_LEAVE_URL"
WAIT_VARIABLE: Final = "ROBOT_OFFLOAD_LEAVE_S"
MARGIN_S: Final = 5
"""Beyond the longest call: the agent looks for pods that leave each second."""
_MEMBER: Final = f'member = "pod_" + re.sub("[^a-z0-9]", "_", os.environ["{POD_VARIABLE}"])\n'
_START: Final = f"""\
import os, re, sys
{_MEMBER}\
words = [word.replace("/{THIS_POD}/", "/" + member + "/") for word in sys.argv[1:]]
os.execvp(words[0], words)
"""
_LEAVE: Final = f"""\
import os, re, urllib.request
{_MEMBER}\
opener = urllib.request.build_opener(urllib.request.ProxyHandler({{}}))
request = urllib.request.Request(os.environ["{URL_VARIABLE}"] + "/" + member, data=b"", method="POST")
try:
    opener.open(request, timeout=float(os.environ["{WAIT_VARIABLE}"])).read()
except OSError as error:
    print("the agent has not confirmed that all calls are answered:", error)
"""


def named(words: Sequence[str]) -> tuple[str, ...]:
    """Return a command line that puts the pod's own name into another one and becomes it."""
    return ("python3", "-c", _START, *words)


def pre_stop() -> Manifest:
    """Return the `lifecycle` of a container that ends when its calls are answered, and gets no new ones meanwhile."""
    return {"preStop": {"exec": {"command": ["python3", "-c", _LEAVE]}}}


def leave_s(node: Node) -> int:
    """Return how long a pod waits for the end of its calls: its callers wait no longer than `timeout`."""
    return max((service.timeout_ms for service in node.services), default=0) // 1000 + 1 + MARGIN_S


def grace_s(node: Node) -> int:
    """Return the seconds between the wish to stop a pod and its kill."""
    return leave_s(node) + handover.GRACE_S


def environment(node: Node, host: str, uid: str) -> dict[str, str | Manifest]:
    """Return what a pod needs to know of itself, and where the reporter of its RobotOffload is."""
    return {
        POD_VARIABLE: {"fieldRef": {"apiVersion": "v1", "fieldPath": "metadata.name"}},
        URL_VARIABLE: f"http://{host}:{handover.PORT}/leave/{handover.proof(uid)}",
        WAIT_VARIABLE: str(leave_s(node)),
    }
