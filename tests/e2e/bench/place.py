"""Where the bench measures: a cluster, and namespaces that go with each measurement."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

from robot_offload_lab.cluster.any_cluster import AnyCluster
from tests.e2e.figures import OUT
from tests.e2e.images import Images
from tests.e2e.story import Story


@dataclass
class Place:
    """A cluster with our chart in it.

    Attributes:
        cluster: the cluster.
        images: on its nodes.
        quick: fewer repetitions, shorter windows.
    """

    cluster: AnyCluster
    images: Images
    quick: bool
    _numbers: itertools.count[int] = field(default_factory=itertools.count)

    def story(self, name: str) -> Story:
        """A namespace of its own; a context manager."""
        unique = f"bench-{name}-{next(self._numbers)}"
        return Story(self.cluster, self.images, unique, OUT / "bench" / unique)
