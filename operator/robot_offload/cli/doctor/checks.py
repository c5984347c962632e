"""The checks of `doctor`. Pure: facts come in, findings with the next step go out."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.cli.cluster import INSTALL, Live
from robot_offload.insight.next_steps import NEXT_STEPS
from robot_offload.insight.observed import Observed, time_of

Level: TypeAlias = Literal["ok", "warning", "error", "unknown"]

LEAST_KUBERNETES: Final = (1, 29)
"""Validation rules (CEL) in custom resource definitions are stable since this version."""
LEADER_SILENT_S: Final = 60.0
CLOCKS_DIFFER_S: Final = 5.0
CERTIFICATE_ENDS_D: Final = 14
LEAST_FILES: Final = 1024
LEAST_RECEIVE_BUFFER: Final = 2 * 1024 * 1024
"""Bytes; about ten laser scans with 1000 rays in ten fragments each fit."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check.

    Attributes:
        check: what was checked, one CamelCase word.
        level: ok; warning: a problem later; error: a problem now; unknown: it could not be checked.
        message: what was found.
        step: what to do; empty: nothing.
    """

    check: str
    level: Level
    message: str
    step: str = ""


# -- the cluster ------------------------------------------------------------------------------------------------------


def kubernetes_version(version: Mapping[str, Any]) -> Finding:
    """Check whether the API server is new enough; `version` is its `/version` response."""
    numbers = [re.match(r"\d+", str(version.get(part, ""))) for part in ("major", "minor")]
    told = str(version.get("gitVersion") or "")
    if None in numbers:
        return Finding("KubernetesVersion", "unknown", f"the API server gives no version ({told or 'nothing'})")
    found = tuple(int(number.group()) for number in numbers if number)
    if found < LEAST_KUBERNETES:
        least = ".".join(map(str, LEAST_KUBERNETES))
        return Finding("KubernetesVersion", "error", f"{told} is older than {least}", "Upgrade the cluster.")
    return Finding("KubernetesVersion", "ok", told)


def definition(live: Mapping[str, Any] | None, wanted: Mapping[str, Any]) -> Finding:
    """Check whether the cluster has the custom resource definition of this version.

    Args:
        live: the definition in the cluster; None: there is none.
        wanted: the one that this program would install.
    """
    if live is None:
        return Finding("Definition", "error", "the cluster does not know RobotOffload", INSTALL)
    if _schemas(live) != _schemas(wanted):
        return Finding(
            "Definition",
            "warning",
            "the custom resource definition is of another version than this program",
            "Upgrade the older one: helm upgrade (it brings the definition along), or this program.",
        )
    return Finding("Definition", "ok", "the custom resource definition is of this program's version")


def _schemas(crd: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of each version; the API server completes the other parts."""
    versions = (crd.get("spec") or {}).get("versions") or ()
    return {version["name"]: _filled(version.get("schema") or {}) for version in versions}


def _filled(value: Any) -> Any:
    """Return the value without empty mappings, which the API server drops."""
    if isinstance(value, Mapping):
        return {key: _filled(part) for key, part in value.items() if part != {}}
    return [_filled(part) for part in value] if isinstance(value, list | tuple) else value


def operator_alive(
    deployments: Sequence[Mapping[str, Any]], leases: Sequence[Mapping[str, Any]], now: datetime.datetime
) -> Iterator[Finding]:
    """Check that an operator runs, and that only one leads.

    Args:
        deployments: those of the operator in all namespaces.
        leases: the leader Leases of these namespaces.
        now: the present.
    """
    if not deployments:
        yield Finding("Operator", "error", "no operator is installed", INSTALL)
        return
    for deployment in deployments:
        place, name = deployment["metadata"]["namespace"], deployment["metadata"]["name"]
        if (deployment.get("status") or {}).get("readyReplicas"):
            yield Finding("Operator", "ok", f"{place}/{name} runs")
        else:
            step = f"kubectl describe deployment {name} -n {place}; kubectl logs deployment/{name} -n {place}"
            yield Finding("Operator", "error", f"{place}/{name} has no ready pod", step)
    for lease in leases:
        yield from _leader(lease, now)
    if len(deployments) > 1:
        step = "Uninstall one, or give each its own namespace with watchNamespaces."
        yield Finding("Operator", "warning", f"{len(deployments)} operators are installed", step)


def _leader(lease: Mapping[str, Any], now: datetime.datetime) -> Iterator[Finding]:
    name = f"{lease['metadata']['namespace']}/{lease['metadata']['name']}"
    renewed = time_of(str((lease.get("spec") or {}).get("renewTime") or ""))
    if renewed is None:
        return
    age_s = (now - renewed).total_seconds()
    if age_s < -CLOCKS_DIFFER_S:
        yield Finding(
            "Clocks", "warning", f"the operator's clock is {-age_s:.0f} s ahead of this machine's", CLOCK_STEP
        )
    elif age_s > LEADER_SILENT_S:
        step = "Look at the operator's log; the clocks of its node and of this machine may differ as well."
        yield Finding("Leader", "error", f"the Lease {name} was not renewed for {age_s:.0f} s", step)
    else:
        yield Finding("Leader", "ok", f"the Lease {name} was renewed {max(0.0, age_s):.0f} s ago")


# -- one RobotOffload -------------------------------------------------------------------------------------------------

CLOCK_STEP: Final = "Start a time service on both (chrony or systemd-timesyncd); chronyc tracking shows its state."


def clocks(live: Live, now: datetime.datetime) -> Finding:
    """Check whether the clocks of the cloud agent's node and of this machine agree, as far as one sample can show."""
    written = time_of(live.state.written) if live.state is not None else None
    if written is None:
        return Finding("Clocks", "unknown", f"the cloud agent could not be asked: {live.problem or 'it gives no time'}")
    offset_s = (now - written).total_seconds()
    if abs(offset_s - 0.5) > CLOCKS_DIFFER_S:
        ahead = "behind" if offset_s > 0 else "ahead of"
        return Finding(
            "Clocks", "error", f"the cloud agent's clock is {abs(offset_s):.0f} s {ahead} this machine's", CLOCK_STEP
        )
    return Finding("Clocks", "ok", "the clocks of the cloud agent and of this machine agree within some seconds")


def addresses(offload: RobotOffload, observed: Observed) -> Finding:
    """Check whether the robot's addresses are known."""
    missing = transport.missing_purposes(offload, observed.endpoints)
    if missing:
        return Finding(
            "Addresses",
            "error",
            f"AddressPending: the cluster has given no address yet for {', '.join(missing)}",
            NEXT_STEPS["AddressPending"].at(observed.namespace, observed.name),
        )
    if not observed.endpoints:
        return Finding("Addresses", "ok", "this transport needs none")
    return Finding("Addresses", "ok", ", ".join(f"{each.purpose} {each.address}" for each in observed.endpoints))


def images(offload: RobotOffload) -> Iterator[Finding]:
    """Yield images that may change under their name: robot and cloud would then run different programs."""
    moving = [node for node in offload.spec.cloud_nodes if node.image and _moving(node.image)]
    for node in moving:
        yield Finding(
            "Images",
            "warning",
            f"node {node.name}: {node.image} can mean another image tomorrow",
            "Name a version (:1.2.3) or a digest (@sha256:...), so that both replicas stay alike.",
        )
    if not moving:
        yield Finding("Images", "ok", "all images of cloud nodes name a version")


def _moving(image: str) -> bool:
    if "@" in image:
        return False
    tag = image.rpartition("/")[2].partition(":")[2]
    return tag in {"", "latest", "main", "master", "dev", "edge", "rolling"}


def certificate(end: datetime.datetime | None, observed: Observed, now: datetime.datetime) -> Finding:
    """Check whether the robot's certificate lasts; `end` None: it cannot be read."""
    step = f"kubectl offload bundle {observed.name} -n {observed.namespace} -o DIR, then copy it to the robot."
    if end is None:
        return Finding("Certificate", "unknown", "the robot's certificate cannot be read", step)
    days = (end - now).days
    if days < 0:
        return Finding("Certificate", "error", f"the robot's certificate ended on {end:%Y-%m-%d}", step)
    if days < CERTIFICATE_ENDS_D:
        return Finding("Certificate", "warning", f"the robot's certificate ends on {end:%Y-%m-%d}", step)
    return Finding("Certificate", "ok", f"the robot's certificate lasts until {end:%Y-%m-%d}")


def conditions(observed: Observed) -> Iterator[Finding]:
    """Yield the operator's conditions in short; `explain` shows more."""
    step = f"kubectl offload explain {observed.name} -n {observed.namespace}"
    if not observed.conditions:
        yield Finding("Status", "error", "the operator has not looked at it yet", step)
    elif observed.outdated:
        yield Finding("Status", "warning", "the operator has not dealt with the last change yet", step)
    for condition in observed.conditions:
        if condition.status == "False" and condition.type != "Ready":
            yield Finding(condition.type, "error", f"{condition.reason}: {condition.message}", step)
    if observed.ready:
        yield Finding("Status", "ok", "it is Ready")


def reachable(address: str, problem: str) -> Finding:
    """Check whether a TCP address of the cloud answers from here; `problem` empty: it does."""
    if problem:
        step = "A firewall between here and there, or a load balancer without a ready pod; on the robot this counts."
        return Finding("Network", "warning", f"TCP {address} does not answer from here: {problem}", step)
    return Finding("Network", "ok", f"TCP {address} answers from here")
