"""The requests that the program makes to an API server. Everything else in Kubernetes is deliberately out of reach."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, Protocol, TypeAlias

from robot_offload.kube.kinds import Kind

Manifest = dict[str, Any]
"""One Kubernetes object as written in YAML."""

FIELD_MANAGER: Final = "robot-offload"
"""The only field manager of server-side apply."""
METADATA: Final = "application/json;as=PartialObjectMetadata;g=meta.k8s.io;v=v1"
METADATA_LIST: Final = "application/json;as=PartialObjectMetadataList;g=meta.k8s.io;v=v1"
"""Forms of an answer with nothing but `metadata`, of objects and of lists."""
Verb: TypeAlias = Literal["get", "list", "watch", "apply", "create", "patch", "delete", "patch status"]
"""The kind of a request; requests are counted by it."""
READS: Final = frozenset({"get", "list", "watch"})
"""The read-only verbs."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The objects of a kind to list and to watch.

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
        type: ADDED, MODIFIED or DELETED; BOOKMARK: no change up to this version.
        manifest: the object; of a deleted one its last state.
        version: the resourceVersion to continue from.
    """

    type: str
    manifest: Manifest
    version: str


class KubeApi(Protocol):
    """Reads and writes of objects. Every method raises a `KubeError` if the API server refuses or does not answer."""

    async def get(self, kind: Kind, namespace: str | None, name: str) -> Manifest | None:
        """Return one object, or None if it does not exist."""
        ...

    async def list(
        self, kind: Kind, namespace: str | None = None, labels: Mapping[str, str] | None = None
    ) -> list[Manifest]:
        """Return all objects of a kind in a namespace (None: in all) that carry all `labels`."""
        ...

    def pages(
        self, kind: Kind, namespace: str | None, selection: Selection
    ) -> AsyncIterator[tuple[Sequence[Manifest], str]]:
        """Yield a list in pages, each with the version from which a watch can begin after the last one."""
        ...

    def watch(
        self, kind: Kind, namespace: str | None, selection: Selection, version: str, *, idle_s: float
    ) -> AsyncIterator[Change]:
        """Yield changes after a version, until the API server ends the watch.

        Args:
            kind: of the objects.
            namespace: None: all.
            selection: of the objects.
            version: as from `pages`. `ConflictError` if it is too old.
            idle_s: a connection that is silent for this long is a `SilentError`; the API server sends a bookmark
                every minute.
        """
        ...

    def lines(self, path: str, *, idle_s: float) -> AsyncIterator[bytes]:
        """Yield the lines of a continuing answer, such as a stream behind the API server's proxy, until its end.

        Args:
            path: with its query.
            idle_s: a connection that is silent for this long is a `SilentError`.
        """
        ...

    async def apply(self, manifest: Manifest, *, force: bool = False) -> Manifest:
        """Apply server-side as `FIELD_MANAGER`; create the object if missing.

        Args:
            manifest: the fields to own, with namespace and name. A `metadata.uid` in it is a precondition: the write
                is refused with `ConflictError` if the object is another one or is gone.
            force: take over fields that others changed. Only for an object that is known to be ours.

        Returns:
            The object as the API server has it now.
        """
        ...

    async def create(self, manifest: Manifest) -> Manifest:
        """Create an object; raise `AlreadyExistsError` if the name is taken."""
        ...

    async def patch(
        self, kind: Kind, namespace: str | None, name: str, patch: Mapping[str, Any], *, subresource: str = ""
    ) -> Manifest:
        """Send a JSON merge patch; a `metadata.resourceVersion` in it is a precondition (`ConflictError`)."""
        ...

    async def delete(self, kind: Kind, namespace: str | None, name: str, uid: str) -> None:
        """Delete the object with this uid in the background; ignore a missing one, `ConflictError` for another uid."""
        ...

    async def patch_status(self, manifest: Manifest) -> Manifest:
        """Write `status` of the object with the same uid (and resourceVersion, if given)."""
        ...

    async def close(self) -> None:
        """End all connections."""
        ...
