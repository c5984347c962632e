"""What a failed step means for the status: every error becomes a condition with its text and the next step."""

from __future__ import annotations

import enum

from robot_offload.decide.verdicts import Verdict, no, unknown
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.errors import KubeError


class Step(enum.Enum):
    """The steps of a pass, in words that complete "while the operator ..."."""

    READ = "read the specification"
    OBSERVE = "read what the cluster has"
    SECRETS = "brought the certificates up to date"
    BUILDS = "decided about images"
    DISCOVERY = "applied the discovery servers' Services"
    RENDER = "worked out the objects"
    APPLY = "applied the objects"
    JUDGE = "judged what is there"


def verdict_of(error: Exception, step: Step) -> Verdict:
    """Return what a failed step means for the condition ResourcesApplied."""
    if isinstance(error, KubeError):
        return no(error.reason, f"{error} (while the operator {step.value})")
    if isinstance(error, RobotOffloadError):
        # A RobotOffloadError names what is wrong with the specification and what to write instead.
        return no("CannotRender", f"{error} (while the operator {step.value}); correct spec")
    return unknown(
        "OperatorBug",
        f"The operator broke while it {step.value}: {type(error).__name__}: {error}. Look at the operator's log "
        "and report it with this object; what runs in the cluster stays as it is",
    )
