"""What the program asks of an API server. Everything else in Kubernetes is out of reach on purpose."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, Protocol, TypeAlias

from robot_offload.kube.kinds import Kind

Manifest = dict[str, Any]
"""One Kubernetes object as it is written in YAML."""

FIELD_MANAGER: Final = "robot-offload"
"""The one name under which fields are owned in server-side apply."""
METADATA: Final = "application/json;as=PartialObjectMetadata;g=meta.k8s.io;v=v1"
METADATA_LIST: Final = "application/json;as=PartialObjectMetadataList;g=meta.k8s.io;v=v1"
"""Forms of an answer that have nothing but `metadata`, of objects and of lists."""
Verb: TypeAlias = Literal["get", "list", "watch", "apply", "create", "patch", "delete", "patch status"]
"""What a request asks for; the requests are counted by it."""
READS: Final = frozenset({"get", "list", "watch"})
"""The verbs that change nothing."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Which objects of a kind are listed and watched.

    Attributes:
        labels: a label selector as in URLs; empty: all.
        fields: a field selector as in URLs; empty: all.
        metadata_only: whether the API server leaves out everything but `metadata`.
    """

    labels: str = ""
    fields: str = ""
    metadata_only: bool = False


@dataclass(frozen=True, slots=True)
class Change:
    """One event of a watch.

    Attributes:
        type: ADDED, MODIFIED or DELETED; BOOKMARK: nothing, up to this version.
        manifest: the object; of a deleted one its last state.
        version: the resourceVersion to go on from.
    """

    type: str
    manifest: Manifest
    version: str


class KubeApi(Protocol):
    """Reads and writes of objects. Every method raises a `KubeError` when the API server says no or is silent."""

    async def get(self, kind: Kind, namespace: str | None, name: str) -> Manifest | None:
        """Return one object, or None where there is none."""
        ...

    async def list(
        self, kind: Kind, namespace: str | None = None, labels: Mapping[str, str] | None = None
    ) -> list[Manifest]:
        """Return all objects of a kind in a namespace (None: in all) that carry all `labels`."""
        ...

    def pages(
        self, kind: Kind, namespace: str | None, selection: Selection
    ) -> AsyncIterator[tuple[Sequence[Manifest], str]]:
        """Yield a list in parts, each with the version that a watch can begin from after the last one."""
        ...

    def watch(
        self, kind: Kind, namespace: str | None, selection: Selection, version: str, *, idle_s: float
    ) -> AsyncIterator[Change]:
        """Yield what happens after a version, until the API server ends the watch.

        Args:
            kind: of the objects.
            namespace: None: all.
            selection: which of them.
            version: as from `pages`. `ConflictError` when it is too old.
            idle_s: a connection that is silent for this long is a `SilentError`; the API server sends a bookmark
                every minute.
        """
        ...

    def lines(self, path: str, *, idle_s: float) -> AsyncIterator[bytes]:
        """Yield the lines of an answer that goes on, such as a stream behind the API server's proxy, until its end.

        Args:
            path: with its query.
            idle_s: a connection that is silent for this long is a `SilentError`.
        """
        ...

    async def apply(self, manifest: Manifest, *, force: bool = False) -> Manifest:
        """Return server-side apply as `FIELD_MANAGER`; creates what is missing.

        Args:
            manifest: the fields to own, with namespace and name. A `metadata.uid` in it is a precondition: the write
                is refused with `ConflictError` when the object is another one or is gone.
            force: takes fields over that somebody else changed. Only for an object that is known to be ours.

        Returns:
            The object as the API server has it now.
        """
        ...

    async def create(self, manifest: Manifest) -> Manifest:
        """Create an object; `AlreadyExistsError` when the name is taken."""
        ...

    async def patch(
        self, kind: Kind, namespace: str | None, name: str, patch: Mapping[str, Any], *, subresource: str = ""
    ) -> Manifest:
        """Return JSON merge patch; a `metadata.resourceVersion` in it is a precondition (`ConflictError`)."""
        ...

    async def delete(self, kind: Kind, namespace: str | None, name: str, uid: str) -> None:
        """Delete the object with this uid in the background; quiet when gone, `ConflictError` for another uid."""
        ...

    async def patch_status(self, manifest: Manifest) -> Manifest:
        """Write `status` of the object with the same uid (and resourceVersion, when there is one)."""
        ...

    async def close(self) -> None:
        """End all connections."""
        ...
