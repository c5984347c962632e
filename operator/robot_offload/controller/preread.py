"""The Secrets with certificates, read in a few lists when an operator starts, not in four requests for each robot.

They spare reading and never lead to a write: one counts only as long as the watch knows no other version, and only if
it shows that nothing is to be done. Keys stay until the first pass over their RobotOffload takes them, or until they
are forgotten.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Collection
from typing import Final

from robot_offload.controller.store import Store
from robot_offload.decide import authorities
from robot_offload.kube.kinds import ROBOT_OFFLOAD, SECRET
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.objects import labels

_CERTIFICATES: Final = Selection(f"{labels.MANAGED_BY}={labels.MANAGER},{labels.COMPONENT}=certificates")
_LEVEL: Final = 1


class Preread:
    """Secrets by namespace and name, packed: parsed ones take ten times as much memory."""

    def __init__(self) -> None:
        self._packed: dict[tuple[str, str], bytes] = {}

    def __len__(self) -> int:
        """Return how many Secrets there are."""
        return len(self._packed)

    async def read(self, api: KubeApi, store: Store, served: Collection[str], home: str) -> None:
        """Read the certificates of all RobotOffloads in the store.

        Args:
            api: lists them, page by page.
            store: must be complete.
            served: namespaces whose RobotOffloads this operator serves; empty: all.
            home: the operator's own namespace, where the keys of authorities are.

        Raises:
            KubeError: the API server refuses or does not answer.
        """
        for place in (*served, *({home} - set(served))) if served else (None,):
            async for page, _ in api.pages(SECRET, place, _CERTIFICATES):
                for secret in page:
                    if store.entry(ROBOT_OFFLOAD, *_owner(secret)) is not None:
                        metadata = secret["metadata"]
                        metadata.pop("managedFields", None)
                        packed = zlib.compress(json.dumps(secret).encode(), _LEVEL)
                        self._packed[metadata["namespace"], metadata["name"]] = packed

    def take(self, store: Store, namespace: str, name: str) -> Manifest | None:
        """Take out a Secret; None: it is not here, or the watch knows another version."""
        packed = self._packed.pop((namespace, name), None)
        entry = store.entry(SECRET, namespace, name)
        if packed is None or entry is None:
            return None
        secret: Manifest = json.loads(zlib.decompress(packed))
        metadata = secret["metadata"]
        return secret if (metadata["uid"], metadata["resourceVersion"]) == (entry.uid, entry.version) else None

    def forget(self) -> None:
        """Drop what was not taken."""
        self._packed.clear()


def _owner(secret: Manifest) -> tuple[str, str]:
    metadata = secret["metadata"]
    instance = str((metadata.get("labels") or {}).get(labels.INSTANCE) or "")
    return authorities.serves(secret) or (metadata["namespace"], instance)
