"""The questions of `doctor` to the cluster. What may not be read becomes a finding; the other checks go on."""

from __future__ import annotations

import asyncio
import datetime
from collections.abc import Awaitable, Callable
from typing import Final

from cryptography import x509

from robot_offload import transport
from robot_offload.api.crd import crd
from robot_offload.api.v1alpha1 import RobotOffload, pinned
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, check
from robot_offload.cli.bundle.command import secrets_of
from robot_offload.cli.cluster import find, live
from robot_offload.cli.doctor import checks as checkup
from robot_offload.cli.doctor import machine
from robot_offload.cli.doctor.checks import Finding
from robot_offload.decide.certificates import secret_name
from robot_offload.errors import SpecError
from robot_offload.insight.observed import Observed, observe
from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import CUSTOM_RESOURCE_DEFINITION, DEPLOYMENT, LEASE, ROBOT_OFFLOAD, SECRET
from robot_offload.kube.pages import read_page
from robot_offload.kube.port import KubeApi

OPERATOR_LABELS: Final = {"app.kubernetes.io/name": "robot-offload-operator"}
LEADER_LEASE: Final = "robot-offload-operator"
DEFINITION: Final = f"{ROBOT_OFFLOAD.plural}.{ROBOT_OFFLOAD.group}"

CORRECT: Final = "Correct the field in your file and apply it again."

Question = Callable[[], Awaitable[list[Finding]]]


async def examine_cluster(api: KubeApi) -> list[Finding]:
    """Check what does not depend on a single RobotOffload. Without the first answer, nothing else is asked."""

    async def version() -> list[Finding]:
        return [checkup.kubernetes_version(await read_page(api, "/version") or {})]

    async def definition() -> list[Finding]:
        return [checkup.definition(await api.get(CUSTOM_RESOURCE_DEFINITION, None, DEFINITION), crd())]

    async def operator() -> list[Finding]:
        deployments = await api.list(DEPLOYMENT, None, OPERATOR_LABELS)
        places = sorted({deployment["metadata"]["namespace"] for deployment in deployments})
        leases = await asyncio.gather(*(api.get(LEASE, place, LEADER_LEASE) for place in places))
        return list(checkup.operator_alive(deployments, [lease for lease in leases if lease], _now()))

    found = await _answered("ApiServer", version, "error")
    if found[0].check == "ApiServer":
        return found
    return found + await _answered("Definition", definition) + await _answered("Operator", operator)


async def examine_one(
    api: KubeApi, hurry: KubeApi, namespace: str, name: str
) -> tuple[list[Finding], RobotOffload | None]:
    """Check one RobotOffload; return the findings, and the RobotOffload if it is valid.

    Raises:
        InputError: it does not exist.
    """
    manifest = await find(api, namespace, name)
    observed = observe(manifest)
    findings = list(checkup.conditions(observed))
    try:
        offload = parse_object(manifest, f"{namespace}/{name}", unknown="ignore", rules=CLUSTER_CHECKS)
    except SpecError as error:
        return findings + [Finding("Specification", "error", each.line(), CORRECT) for each in error.findings], None
    warnings = (*check(offload.spec, CLUSTER_CHECKS), *pinned.findings(offload))
    findings += [Finding("Specification", "warning", each.line(), CORRECT) for each in warnings]
    findings.append(checkup.addresses(offload, observed))
    findings += checkup.images(offload)

    async def certificate() -> list[Finding]:
        secrets = secrets_of(await api.get(SECRET, namespace, secret_name(name, "robot")))
        end = x509.load_pem_x509_certificate(secrets.certificate).not_valid_after_utc if secrets else None
        return [checkup.certificate(end, observed, _now())]

    if transport.needs_certificates(offload.spec):
        findings += await _answered("Certificate", certificate)
    findings.append(checkup.clocks(await live(hurry, namespace, name), _now()))
    return findings + await _network(observed), offload


async def _network(observed: Observed) -> list[Finding]:
    """Check whether the TCP addresses answer; UDP is not checked, because silence there means nothing."""
    wanted = [endpoint for endpoint in observed.endpoints if endpoint.protocol == "TCP"]
    problems = await asyncio.gather(
        *(asyncio.to_thread(machine.tcp_problem, endpoint.host, endpoint.port) for endpoint in wanted)
    )
    return [checkup.reachable(endpoint.address, problem) for endpoint, problem in zip(wanted, problems, strict=True)]


async def _answered(name: str, question: Question, level: checkup.Level = "unknown") -> list[Finding]:
    """Return the findings of a question, or one finding with the reason if the API server does not answer."""
    try:
        return await question()
    except KubeError as error:
        step = "kubectl auth whoami; kubectl cluster-info" if level == "error" else "Ask for the right, if you need it."
        return [Finding(name, level, str(error), step)]


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)
