"""`robot-offload export`: a RobotOffload with the keys of its authorities, for another cluster."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Final

import typer
import yaml

from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import Context, Kubeconfig, Name, Namespace, Target, find
from robot_offload.decide.authorities import ORPHANED, secret_names
from robot_offload.errors import InputError, RobotOffloadError
from robot_offload.kube.errors import ForbiddenError
from robot_offload.kube.kinds import SECRET
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects.facts import HOME

EXAMPLES = (
    "robot-offload export wheelchair-7 -o wheelchair-7.yaml",
    "kubectl offload export wheelchair-7 -o w.yaml && kubectl --context other apply -f w.yaml",
)
_KEPT: Final = ("name", "namespace", "labels", "annotations")
"""The metadata that stays the same in another cluster."""
_LEFT_OUT: Final = ("kubectl.kubernetes.io/last-applied-configuration", ORPHANED)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("export", epilog=example_text(EXAMPLES))(export)


def export(
    name: Name,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="File to write; it must not exist.")],
    home: Annotated[
        str, typer.Option("--operator-namespace", metavar="NAME", help="Where the operator keeps the keys.")
    ] = HOME,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Write a RobotOffload and the keys of its authorities, to apply in another cluster.

    The operator there goes on with the keys, so the robot's bundle stays good as long as its address leads there.
    Whoever reads the file can pretend to be the robot and its cloud.
    """
    if output.exists():
        raise InputError(f"{output} exists; name another file")
    target = Target(kubeconfig, context, namespace)
    place = target.namespace
    objects = target.run(lambda api: _read(api, place, name, home))
    output.touch(mode=0o600)
    output.write_text(yaml.safe_dump_all(objects, sort_keys=False, allow_unicode=True), encoding="utf-8")
    typer.echo(f"{output}: {place}/{name} and {len(objects) - 1} Secrets for namespace {home}; keep it secret")
    typer.echo(f"Next: kubectl offload pin {name} robot here, then kubectl apply -f {output} in the other cluster.")


async def _read(api: KubeApi, place: str, name: str, home: str) -> list[Manifest]:
    manifest = await find(api, place, name)
    uid = manifest["metadata"]["uid"]
    try:
        found = await asyncio.gather(*(api.get(SECRET, home, secret) for secret in secret_names(uid).values()))
    except ForbiddenError as error:
        raise RobotOffloadError(f"{error}. The file holds the keys: you need get on secrets in {home}") from error
    secrets = [portable(secret) for secret in found if secret is not None]
    if len(secrets) < len(found):
        raise RobotOffloadError(
            f"{place}/{name}: there are no keys of its authorities in namespace {home}; name the operator's namespace "
            "with --operator-namespace. Transports without certificates and those of your own issuer have none"
        )
    return [*secrets, portable(manifest)]


def portable(manifest: Manifest) -> Manifest:
    """Return an object without what belongs to its present cluster."""
    metadata = {key: manifest["metadata"][key] for key in _KEPT if manifest["metadata"].get(key)}
    annotations = {key: text for key, text in metadata.get("annotations", {}).items() if key not in _LEFT_OUT}
    if annotations:
        metadata["annotations"] = annotations
    else:
        metadata.pop("annotations", None)
    rest = {key: value for key, value in manifest.items() if key not in ("metadata", "status")}
    return {"apiVersion": rest.pop("apiVersion"), "kind": rest.pop("kind"), "metadata": metadata, **rest}
