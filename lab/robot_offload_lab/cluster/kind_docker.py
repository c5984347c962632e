"""What clusters of kind need of Docker: whether it answers, its network for a cluster, a cluster's leftovers."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import IO

from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.kind_layout import KindLayout
from robot_offload_lab.cluster.layout import Layout

LABEL = "io.x-k8s.kind.cluster"
"""Label that kind puts on its containers; the value is the name of the cluster."""

_NOTE = "docker.txt"
_BRIDGE = "com.docker.network.bridge.name"
_PATIENCE = 20.0  # seconds until a silent Docker counts as not answering


def silent() -> str:
    """Return why Docker cannot be used; empty when it answers."""
    if shutil.which("docker") is None:
        return "there is no command docker"
    try:
        done = subprocess.run(
            ["docker", "info", "--format", "{{.ServerVersion}}"],
            capture_output=True,
            text=True,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"Docker says nothing for {_PATIENCE:.0f} s"
    # Some versions of the client end without an error although there was no answer.
    if done.returncode or not done.stdout.strip():
        said = (done.stderr.strip() or "no version").splitlines()[-1]
        return f"Docker does not answer ({said})"
    return ""


def run(*arguments: str, stdin: IO[bytes] | None = None, limit: float = 300.0) -> str:
    """Run docker and return what it printed.

    Args:
        arguments: Arguments of the command.
        stdin: An open file for its standard input.
        limit: Seconds after which it counts as hung.

    Raises:
        ClusterError: It failed.
    """
    command = ["docker", *arguments]
    source = subprocess.DEVNULL if stdin is None else stdin
    try:
        done = subprocess.run(command, stdin=source, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        raise ClusterError(f"{' '.join(command)}: it does not end within {limit:.0f} s") from None
    if done.returncode:
        raise ClusterError(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout


def inside(container: str, *command: str) -> str:
    """Run a command in a container and return what it printed."""
    return run("exec", container, *command)


def address(container: str, network: str) -> str:
    """Return the address of a container in a network."""
    template = f'{{{{(index .NetworkSettings.Networks "{network}").IPAddress}}}}'
    return run("inspect", "--format", template, container).strip()


def running(container: str) -> bool:
    """Return whether a container runs."""
    return container in run("ps", "--filter", f"name=^{container}$", "--format", "{{.Names}}").split()


def make_network(layout: KindLayout) -> None:
    """Make the network of a cluster; from now on `remove` also cleans up in Docker."""
    _note(layout).touch()
    kept = [word for n, each in enumerate(layout.kept_from_docker) for word in ("--aux-address", f"kept{n}={each}")]
    run(
        *("network", "create", "--driver", "bridge", "--subnet", layout.first_network),
        *("--gateway", layout.host, "--ip-range", layout.given_by_docker, *kept),
        *("--opt", f"{_BRIDGE}={layout.kind}", "--label", f"{LABEL}={layout.kind}", layout.kind),
    )


def containers(layout: KindLayout) -> list[str]:
    """Return the containers of a cluster, running or not."""
    return run("ps", "--all", "--filter", f"label={LABEL}={layout.kind}", "--format", "{{.Names}}").split()


def networks(layout: KindLayout) -> list[str]:
    """Return the networks of a cluster."""
    return run("network", "ls", "--filter", f"label={LABEL}={layout.kind}", "--format", "{{.Name}}").split()


def uses(layout: Layout) -> bool:
    """Return whether a cluster has, or had until it was killed, anything in Docker."""
    return _note(layout).exists()


def refuse_strangers(layout: KindLayout) -> None:
    """Refuse to reuse names that another program has taken in Docker.

    Raises:
        ClusterError: Something has one of our names.
    """
    if strange := [*containers(layout), *networks(layout)]:
        raise ClusterError(
            f"Docker has these of our names, but no cluster of ours made them: {', '.join(strange)}. "
            f"Next: remove them, or take another number"
        )


def remove(layout: Layout) -> None:
    """Remove the containers of a cluster with their volumes, and its network, however it ended.

    Raises:
        ClusterError: Docker does not answer, so that its leftovers are not known.
    """
    if not uses(layout):
        return
    if why := silent():
        raise ClusterError(f"Cluster {layout.number} has containers, and {why}. Next: start Docker, then: down")
    ours = KindLayout(layout.number)
    if names := containers(ours):
        run("rm", "--force", "--volumes", *names)
    if names := networks(ours):
        run("network", "rm", *names)
    _note(layout).unlink()


def left(layout: Layout) -> int:
    """Return how many containers and networks of a cluster still exist."""
    if not uses(layout):
        return 0
    ours = KindLayout(layout.number)
    return len(containers(ours)) + len(networks(ours))


def _note(layout: Layout) -> Path:
    return layout.home / _NOTE
