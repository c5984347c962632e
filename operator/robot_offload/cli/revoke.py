"""`robot-offload revoke`: invalidate a robot's certificates; the robot then needs a new bundle."""

from __future__ import annotations

import datetime
import sys
from typing import Annotated

import typer

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import Context, Kubeconfig, Name, Namespace, Target, find
from robot_offload.decide.certificates import REVOKE
from robot_offload.errors import InputError
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi

EXAMPLES = (
    "robot-offload revoke wheelchair-7",
    "kubectl offload revoke wheelchair-7 --yes && kubectl offload bundle wheelchair-7 -o wheelchair-7",
)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("revoke", epilog=example_text(EXAMPLES))(revoke)


def revoke(
    name: Name,
    *,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")] = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Make a robot's certificates worthless, after it was lost, sold or copied.

    The operator makes a new client authority and a new key for the robot, and the cloud agent closes its sessions.
    The robot keeps acting alone until it has a new bundle. There is no way back.
    """
    target = Target(kubeconfig, context, namespace)
    place = target.namespace

    async def read(api: KubeApi) -> str:
        manifest = await find(api, place, name)
        refuse_if_not_ours(parse_object(manifest, f"{place}/{name}", unknown="ignore", rules=()))
        return str(manifest["metadata"]["uid"])

    uid = target.run(read)
    if not yes:
        _ask(name, place)
    moment = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds").replace("+00:00", "Z")

    async def write(api: KubeApi) -> None:
        body = {"metadata": {"uid": uid, "annotations": {REVOKE: moment}}}
        await api.patch(ROBOT_OFFLOAD, place, name, body)

    target.run(write)
    typer.echo(f"{name}: the robot's certificates are being replaced; its present ones count no more")
    typer.echo(f"Next: kubectl offload bundle {name} -n {place} -o DIR, and copy the folder to the robot.")


def refuse_if_not_ours(offload: RobotOffload) -> None:
    """Refuse if there is nothing that the operator could revoke.

    Raises:
        InputError: the message names where to revoke instead.
    """
    name, spec = offload.metadata.name, offload.spec
    if not transport.needs_certificates(spec):
        raise InputError(f"{name}: transport {spec.transport.type} has no certificates of ours to revoke")
    if spec.transport.certificates.issuer_ref is not None:
        raise InputError(f"{name}: its certificates come from your own issuer; revoke them there")


def _ask(name: str, place: str) -> None:
    if not sys.stdin.isatty():
        raise InputError(f"revoking {place}/{name} cuts the robot off until it has a new bundle; say so with --yes")
    if not typer.confirm(f"{place}/{name} will be cut off until it has a new bundle. Revoke?", err=True):
        raise InputError("nothing was changed")
