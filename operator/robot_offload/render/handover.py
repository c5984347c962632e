"""The preStop hook: before a pod of the active side stops, the robot takes over."""

from __future__ import annotations

import hashlib
from typing import Final

from robot_offload.kube.port import Manifest

GRACE_S: Final = 20
"""Seconds between the request to stop a pod and its kill: enough for the hook and for the process to end."""
PORT: Final = 8080
"""Of the reporter."""
PROOF_VARIABLE: Final = "HANDOVER_PROOF"
"""Of the reporter's environment."""
URL_VARIABLE: Final = "ROBOT_OFFLOAD_HANDOVER_URL"

# The same text in every pod; everything variable is in the environment, so a user's text is never run as code.
# No proxies: the agent is in the same cluster. A failure is reported and does not delay the pod.
_SCRIPT: Final = f"""\
import os, urllib.request
opener = urllib.request.build_opener(urllib.request.ProxyHandler({{}}))
request = urllib.request.Request(os.environ["{URL_VARIABLE}"], data=b"", method="POST")
try:
    opener.open(request, timeout=15).read()
except OSError as error:
    print("the robot has not confirmed that it takes over:", error)
"""


def pre_stop() -> Manifest:
    """Return the `lifecycle` of a container whose end must not affect the robot."""
    return {"preStop": {"exec": {"command": ["python3", "-c", _SCRIPT]}}}


def proof(uid: str) -> str:
    """Return the proof that a handover request must carry: a word derived from the RobotOffload's uid.

    No other pod knows it, so none can hold the robot off the cloud where network policies are not enforced.
    """
    return hashlib.sha256(f"handover of {uid}".encode()).hexdigest()[:32]


def url(host: str, uid: str) -> str:
    """Return the handover URL of the reporter of the RobotOffload with this uid."""
    return f"http://{host}:{PORT}/handover/{proof(uid)}"
