"""Nodes with several pods: the names of each pod, and its end without a lost call.

Each pod serves under private names that contain its own name, which only the pod itself knows: a few lines of Python
put it into the node's arguments. The same text runs in every pod, so a user's text is never run as code.
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
"""Beyond the longest call: the agent looks for leaving pods each second."""
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
    """Return a command line that puts the pod's own name into `words` and replaces itself with them."""
    return ("python3", "-c", _START, *words)


def pre_stop() -> Manifest:
    """Return the `lifecycle` of a container that gets no new calls and ends when its calls are answered."""
    return {"preStop": {"exec": {"command": ["python3", "-c", _LEAVE]}}}


def leave_s(node: Node) -> int:
    """Return how long a pod waits for the end of its calls: callers wait at most `timeout`."""
    return max((service.timeout_ms for service in node.services), default=0) // 1000 + 1 + MARGIN_S


def grace_s(node: Node) -> int:
    """Return the seconds between the request to stop a pod and its kill."""
    return leave_s(node) + handover.GRACE_S


def environment(node: Node, host: str, uid: str) -> dict[str, str | Manifest]:
    """Return the variables with the pod's own facts and its RobotOffload's reporter."""
    return {
        POD_VARIABLE: {"fieldRef": {"apiVersion": "v1", "fieldPath": "metadata.name"}},
        URL_VARIABLE: f"http://{host}:{handover.PORT}/leave/{handover.proof(uid)}",
        WAIT_VARIABLE: str(leave_s(node)),
    }
