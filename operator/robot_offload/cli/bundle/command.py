"""`robot-offload bundle`: the folder with everything that a robot needs; it works offline afterwards."""

from __future__ import annotations

import asyncio
import base64
import datetime
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from rich.console import Console
from rich.status import Status

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload, pinned
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.quantities import parse_duration
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS
from robot_offload.cli.app import example_text
from robot_offload.cli.bundle import folder
from robot_offload.cli.cluster import Context, Kubeconfig, Name, Namespace, Target, find
from robot_offload.cli.own_images import images_in_use
from robot_offload.decide.authorities import identity_of
from robot_offload.decide.certificates import LEAVES, REVOKE, REVOKED, secret_name
from robot_offload.errors import InputError, RobotOffloadError
from robot_offload.insight.next_steps import NEXT_STEPS
from robot_offload.insight.observed import Observed, observe
from robot_offload.kube.errors import ForbiddenError
from robot_offload.kube.kinds import DEPLOYMENT, SECRET
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects.facts import Facts
from robot_offload.objects.labels import INSTANCE
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import (
    PRIVATE_KEY,
    AddressPendingError,
    BundleSecrets,
    bundle,
    default_folder,
)

EXAMPLES = (
    "robot-offload bundle wheelchair-7 -o wheelchair-7",
    "kubectl offload bundle wheelchair-7 -n ward -o wheelchair-7 --timeout 5m",
    "scp -r wheelchair-7 robot:/tmp/ && ssh robot sudo mv /tmp/wheelchair-7 /etc/robot-offload/",
)
LOOK_EVERY_S: Final = 1.0
KEYS: Final = ("ca.crt", "tls.crt", "tls.key")


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("bundle", epilog=example_text(EXAMPLES))(bundle_command)


@dataclass(frozen=True, slots=True)
class Material:
    """Everything from which a bundle is made, as far as it exists.

    Attributes:
        observed: the RobotOffload.
        offload: the same, read strictly.
        secrets: the robot's credentials; None: not there (yet), or not needed.
        revoking: whether its certificates are being replaced.
        deployments: its Deployments.
        identity: the uid by which the robot knows its cloud; empty: the RobotOffload's uid.
    """

    observed: Observed
    offload: RobotOffload
    secrets: BundleSecrets | None
    revoking: bool
    deployments: tuple[Manifest, ...] = ()
    identity: str = ""


def bundle_command(
    name: Name,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write; made if need be.")],
    place: Annotated[
        str, typer.Option("--folder", help="Where the folder will lie on the robot. Default: /etc/robot-offload/NAME.")
    ] = "",
    timeout: Annotated[str, typer.Option(metavar="TIME", help="How long to wait for address and certificates.")] = "2m",
    force: Annotated[
        bool, typer.Option("--force", help="Write into a folder that holds other files or another robot's bundle.")
    ] = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Write the folder that a robot needs: agent configuration, certificates, environment, systemd unit, compose file.

    It waits until the cluster has given the Services an address, and ends with 1 (AddressPending) when that takes too
    long. The private key is readable by the owner only. Copy the folder to one robot and to no other.
    """
    limit_s = _seconds(timeout)
    target = Target(kubeconfig, context, namespace)
    where = target.namespace
    with _progress() as say:
        material = target.run(lambda api: _wait(api, where, name, limit_s, say))
    files = bundle(Parent(material.offload, facts_of(material)), material.secrets, folder=place)
    mark = folder.Mark(where, name, material.observed.uid, material.observed.generation, tuple(files))
    folder.write(output, files, (PRIVATE_KEY,), mark, force=force)
    for line in told(material, output, place or default_folder(material.offload), files):
        typer.echo(line)


def facts_of(material: Material) -> Facts:
    """Return the facts that rendering needs."""
    return Facts(
        namespace=material.observed.namespace,
        uid=material.observed.uid,
        identity=material.identity,
        generation=material.observed.generation,
        images=images_in_use(list(material.deployments)),
        nodes_wanted=True,
        endpoints=material.observed.endpoints,
    )


def waiting_for(material: Material) -> tuple[str, str]:
    """Return what is still missing, as one word and one sentence; both are empty if everything is there.

    Raises:
        RobotOffloadError: waiting does not help.
    """
    observed, name = material.observed, material.observed.name
    valid = observed.condition("SpecValid")
    if valid is not None and not valid.holds and not observed.outdated:
        raise RobotOffloadError(f"{name}: SpecValid is False ({valid.reason}); see: kubectl offload explain {name}")
    if observed.outdated:
        return "InProgress", "the operator has not dealt with the last change yet; is it running?"
    if transport.needs_certificates(material.offload.spec):
        if material.revoking:
            return "CertificatesPending", "the revoked certificates are being replaced"
        if material.secrets is None:
            return "CertificatesPending", "the robot's certificate is not made yet"
    missing = transport.missing_purposes(material.offload, observed.endpoints)
    if missing:
        return "AddressPending", f"the cluster has given no address yet for {', '.join(missing)}"
    return "", ""


def told(material: Material, output: Path, place: str, files: Mapping[str, bytes]) -> list[str]:
    """Return the final message, as lines."""
    name = material.observed.name
    lines = [f"{output}: the bundle of {name}, generation {material.observed.generation}, {len(files) + 1} files"]
    if PRIVATE_KEY in files and material.secrets is not None:
        end = x509.load_pem_x509_certificate(material.secrets.certificate).not_valid_after_utc
        lines.append(f"The robot's certificate ends on {end:%Y-%m-%d}; write the bundle again before.")
        lines.append(f"{output / PRIVATE_KEY} is secret: it goes to this robot alone.")
    lines.append(f"Next: copy the folder to {place} on the robot, then follow its README.md.")
    return lines


async def _wait(api: KubeApi, where: str, name: str, limit_s: float, say: Callable[[str], None]) -> Material:
    end_s = time.monotonic() + limit_s
    while True:
        material = await _gather(api, where, name)
        reason, message = waiting_for(material)
        if not reason:
            return material
        if time.monotonic() >= end_s:
            raise AddressPendingError(f"{name}: {reason}: {message}. Next: {NEXT_STEPS[reason].at(where, name)}")
        say(f"Waiting ({reason}): {message}")
        await asyncio.sleep(min(LOOK_EVERY_S, max(0.05, end_s - time.monotonic())))


async def _gather(api: KubeApi, where: str, name: str) -> Material:
    manifest = await find(api, where, name)
    parsed = parse_object(manifest, f"{where}/{name}", unknown="ignore", rules=CLUSTER_CHECKS)
    offload = pinned.held(parsed, pinned.observed(manifest).side)
    secrets, revoking, identity = None, False, ""
    if transport.needs_certificates(offload.spec):
        try:
            cloud, robot = await asyncio.gather(*(api.get(SECRET, where, secret_name(name, role)) for role in LEAVES))
        except ForbiddenError as error:
            raise RobotOffloadError(f"{error}. The bundle holds the robot's key: you need get on secrets") from error
        secrets, identity = secrets_of(robot), identity_of(robot)
        if offload.spec.transport.certificates.issuer_ref is None:
            revoking = revocation_pending(manifest, cloud) or not (secrets is None or trusted_by(cloud, secrets))
    deployments = await api.list(DEPLOYMENT, where, {INSTANCE: name})
    return Material(observe(manifest), offload, secrets, revoking, tuple(deployments), identity)


def secrets_of(secret: Manifest | None) -> BundleSecrets | None:
    """Return the robot's credentials; None: they are not complete yet."""
    data: Mapping[str, str] = (secret or {}).get("data") or {}
    if not all(data.get(key) for key in KEYS):
        return None
    return BundleSecrets(*(base64.b64decode(data[key]) for key in KEYS))


def revocation_pending(manifest: Mapping[str, Any], cloud: Manifest | None) -> bool:
    """Return whether a requested revocation is not yet answered by the Secret of the cloud's certificate."""
    asked = (manifest["metadata"].get("annotations") or {}).get(REVOKE, "")
    answered = ((cloud or {}).get("metadata", {}).get("annotations") or {}).get(REVOKED, "")
    return bool(asked) and asked != answered


def trusted_by(cloud: Manifest | None, secrets: BundleSecrets) -> bool:
    """Return whether the cloud accepts a robot's certificate: the cloud's Secret holds the authority for robots.

    While certificates are being replaced, the authority is briefly newer than the robot's certificate.
    """
    try:
        issuer = x509.load_pem_x509_certificate(base64.b64decode((cloud or {})["data"]["ca.crt"]))
        x509.load_pem_x509_certificate(secrets.certificate).verify_directly_issued_by(issuer)
    except (KeyError, ValueError, TypeError, InvalidSignature):
        return False
    return True


def _progress() -> AbstractContextManager[Callable[[str], None]]:
    """Show what the command waits for: a moving line on a terminal, else one line for each new reason."""
    if sys.stderr.isatty():
        return _Spinner()
    said: list[str] = []

    def say(text: str) -> None:
        if text not in said:
            said.append(text)
            typer.echo(text, err=True)

    return nullcontext(say)


class _Spinner(AbstractContextManager[Callable[[str], None]]):
    def __init__(self) -> None:
        self._begin = datetime.datetime.now(datetime.UTC)
        self._status = Status("Reading", console=Console(stderr=True))

    def __enter__(self) -> Callable[[str], None]:
        self._status.start()
        return self._say

    def __exit__(self, *_: object) -> None:
        self._status.stop()

    def _say(self, text: str) -> None:
        seconds = (datetime.datetime.now(datetime.UTC) - self._begin).total_seconds()
        self._status.update(f"{text} ({seconds:.0f} s)")


def _seconds(text: str) -> float:
    try:
        return parse_duration(text) / 1000
    except ValueError as error:
        raise InputError(f"--timeout: {error}") from None
