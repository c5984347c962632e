"""kubectl and helm bound to one cluster and one namespace; the caller's own configuration does not reach them."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from robot_offload_lab.cluster.errors import CommandError

Manifest = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Command:
    """A program that talks to the cluster."""

    program: Path
    kubeconfig: Path
    namespace: str
    """Where it acts; empty: as the objects state, which may then be of several namespaces."""

    limit: float = 120.0
    """Seconds after which a command counts as hung."""

    def __call__(self, *arguments: str, stdin: str | None = None) -> str:
        """Run it and return what it printed.

        Raises:
            CommandError: It failed; the message holds the command and its error output.
        """
        done = self._run(arguments, stdin)
        if done.returncode:
            raise CommandError(f"{self.program.name} {' '.join(arguments)}: {done.stderr.strip()}")
        return done.stdout

    def refuses(self, *arguments: str, stdin: str | None = None) -> str:
        """Run it, expect it to fail, and return its error output."""
        done = self._run(arguments, stdin)
        if not done.returncode:
            raise CommandError(f"{self.program.name} {' '.join(arguments)} should fail, but it printed: {done.stdout}")
        return done.stderr

    def _run(self, arguments: tuple[str, ...], stdin: str | None) -> subprocess.CompletedProcess[str]:
        home = str(self.kubeconfig.parent)
        place = ["--namespace", self.namespace] if self.namespace else []
        return subprocess.run(
            [str(self.program), "--kubeconfig", str(self.kubeconfig), *place, *arguments],
            input=stdin if stdin is not None else "",
            env={"PATH": os.environ["PATH"], "HOME": home},  # no KUBECONFIG, no HELM_*: never another cluster
            capture_output=True,
            text=True,
            timeout=self.limit,
            check=False,
        )


@dataclass(frozen=True, slots=True)
class Kubectl(Command):
    """kubectl."""

    def within(self, namespace: str) -> Kubectl:
        """Return this kubectl for another namespace."""
        return replace(self, namespace=namespace)

    def json(self, *arguments: str) -> Any:
        """Run it with `-o json` and return the parsed answer."""
        return json.loads(self(*arguments, "-o", "json"))

    def apply(self, *manifests: Manifest, options: tuple[str, ...] = ("--server-side",)) -> str:
        """Apply objects; server-side by default."""
        return self("apply", *options, "-f", "-", stdin=documents(*manifests))

    def apply_refused(self, *manifests: Manifest, options: tuple[str, ...] = ("--server-side",)) -> str:
        """Apply objects, expect the API server to refuse them, and return why."""
        return self.refuses("apply", *options, "-f", "-", stdin=documents(*manifests))

    def names(self, kinds: str, *arguments: str) -> list[str]:
        """Return `kind/name` of every object of these kinds, sorted."""
        return sorted(self("get", kinds, "-o", "name", *arguments).split())


@dataclass(frozen=True, slots=True)
class Helm(Command):
    """helm."""


def documents(*manifests: Manifest) -> str:
    """Return objects in the form that `kubectl apply -f -` reads.

    Not as one `List`: kubectl would skip the server's validation and only do its own.
    """
    return "\n---\n".join(json.dumps(dict(each)) for each in manifests)
