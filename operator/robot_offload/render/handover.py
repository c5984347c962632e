"""The preStop hook: before a pod of the acting side goes, the robot takes over."""

from __future__ import annotations

import hashlib
from typing import Final

from robot_offload.kube.port import Manifest

GRACE_S: Final = 20
"""Between the wish to stop a pod and its kill: enough for the hook and for the process to end."""
PORT: Final = 8080
"""Of the reporter."""
PROOF_VARIABLE: Final = "HANDOVER_PROOF"
"""Of the reporter's environment."""
URL_VARIABLE: Final = "ROBOT_OFFLOAD_HANDOVER_URL"

# The same text in every pod; what differs is in the environment, so nothing that a user wrote is ever run as code.
# Proxies are left out: the agent is in the same cluster. A failure is told and does not hold the pod up.
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
    """Return the `lifecycle` of a container whose end the robot must not notice."""
    return {"preStop": {"exec": {"command": ["python3", "-c", _SCRIPT]}}}


def proof(uid: str) -> str:
    """Return what whoever asks for a handover must know: a word that follows from the RobotOffload's uid.

    No other pod knows that, so that none can hold the robot off the cloud where no network policies count.
    """
    return hashlib.sha256(f"handover of {uid}".encode()).hexdigest()[:32]


def url(host: str, uid: str) -> str:
    """Return where the reporter of the RobotOffload with this uid is asked for a handover."""
    return f"http://{host}:{PORT}/handover/{proof(uid)}"
