"""Our chart in a cluster, with the images of this run."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Final

from robot_offload_lab.cluster.any_cluster import AnyCluster
from tests.e2e.images import OURS, Images
from tests.integration.chart import CHART, RELEASE, Values, with_values

NAMESPACE: Final = "robot-offload-system"
DEPLOYMENT: Final = "deployment/robot-offload-operator"
PATIENCE: Final = "180s"
LIMIT_S: Final = 240.0


class Chart:
    """The release of our chart."""

    def __init__(self, cluster: AnyCluster, images: Images) -> None:
        self._cluster = cluster
        self._images = images

    def install(self) -> float:
        """`helm install`, as the how-to says; returns the seconds until the operator is ready."""
        return self._timed("install", "--create-namespace")

    def upgrade(self, **values: object) -> float:
        """`helm upgrade` with these values beside the images; returns the seconds until the operator is ready."""
        return self._timed("upgrade", values={key.replace("__", "."): value for key, value in values.items()})

    def rollback(self) -> float:
        """`helm rollback` to the release before; returns the seconds until the operator is ready."""
        began_s = time.monotonic()
        self._helm("rollback", RELEASE, "--wait", "--timeout", PATIENCE)
        return time.monotonic() - began_s

    def uninstall(self) -> None:
        """`helm uninstall`."""
        self._helm("uninstall", RELEASE, "--wait", "--timeout", PATIENCE)

    def values(self) -> Values:
        """The images of this run."""
        return {f"images.{name}": self._images.references[name] for name in OURS}

    def _timed(self, verb: str, *options: str, values: Values = {}) -> float:  # noqa: B006 - never changed
        began_s = time.monotonic()
        chosen = with_values({**self.values(), **values})
        self._helm(verb, RELEASE, str(CHART), *options, *chosen, "--wait", "--timeout", PATIENCE)
        return time.monotonic() - began_s

    def _helm(self, *arguments: str) -> str:
        # helm itself gives up first, and says what it waited for.
        return replace(self._cluster.helm(NAMESPACE), limit=LIMIT_S)(*arguments)
