"""Whether a live object still is what we want. Decides about writes: a steady state needs none.

We own fields, not objects. A child is as wanted if it has every field of the wanted manifest with the same value;
additions by others (defaults, a status, an injected annotation) are theirs. Fields that Kubernetes declares atomic have
one owner as a whole, so an entry that others add to a selector or to subjects changes our field. Fields that we no
longer want are found by the digest of the whole wanted manifest, which is itself one of the wanted fields: an
annotation.

The API server normalizes some values (quantities, times). Its form of a manifest right after our apply is remembered,
and counts as wanted from then on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.decide.ownership import APPLIED
from robot_offload.kube.port import Manifest

_LIST_KEYS: Final = (("containerPort", "protocol"), ("port", "protocol"), ("name",), ("ip",), ("uid",), ("mountPath",))
"""The fields that identify entries of lists of mappings, as in the API server's own schema."""
ATOMIC: Final = frozenset(
    {
        *("selector", "nodeSelector", "podSelector", "namespaceSelector", "labelSelector"),
        *("subjects", "roleRef", "rules", "ingress", "egress", "tolerations"),
        *("secretKeyRef", "configMapKeyRef", "fieldRef", "loadBalancerSourceRanges", "resourceNames"),
    }
)
"""Fields of our children that are atomic in the API server's own schema (x-kubernetes-map-type, -list-type)."""


@dataclass(frozen=True, slots=True)
class Settled:
    """The API server's form of a manifest.

    Attributes:
        digest: of the manifest.
        fields: the manifest's fields as in the answer.
    """

    digest: str
    fields: Any


def digest(manifest: Manifest) -> str:
    """Return a short hash of exactly this manifest."""
    text = json.dumps(manifest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def stamped(manifest: Manifest, uid: str) -> Manifest:
    """Return the manifest with the annotation that identifies it when unchanged."""
    metadata = manifest["metadata"]
    annotations = {**(metadata.get("annotations") or {}), APPLIED: f"{uid}/{digest(manifest)}"}
    return {**manifest, "metadata": {**metadata, "annotations": annotations}}


def in_place(wanted: Manifest, live: Manifest, settled: Settled | None) -> bool:
    """Return whether applying `wanted` (a stamped manifest) would change nothing."""
    fields = projection(wanted, live)
    if fields == wanted:
        return True
    return settled is not None and settled.digest == digest(wanted) and settled.fields == fields


def settle(wanted: Manifest, answer: Manifest) -> Settled | None:
    """Return what to remember after an apply; None: the answer contains the manifest unchanged."""
    fields = projection(wanted, answer)
    return None if fields == wanted else Settled(digest(wanted), fields)


def projection(wanted: Any, live: Any) -> Any:
    """Return the live values of exactly those fields that `wanted` names, atomic ones whole, without missing ones."""
    if isinstance(wanted, Mapping) and isinstance(live, Mapping):
        return {
            key: live[key] if key in ATOMIC else projection(value, live[key])
            for key, value in wanted.items()
            if key in live
        }
    if isinstance(wanted, list | tuple) and isinstance(live, list):
        return _list_projection(list(wanted), live)
    return live


def _list_projection(wanted: list[Any], live: list[Any]) -> list[Any]:
    keys = _keys_for(wanted)
    if keys is None:
        # Whole lists of plain values have one owner: compare them whole.
        if len(wanted) == len(live):
            return [projection(want, have) for want, have in zip(wanted, live, strict=True)]
        return live
    entries = {_entry_key(entry, keys): entry for entry in live if isinstance(entry, Mapping)}
    return [projection(entry, entries[key]) for entry in wanted if (key := _entry_key(entry, keys)) in entries]


def _keys_for(entries: list[Any]) -> tuple[str, ...] | None:
    """Return the fields that identify the entries; None: their order does."""
    if not entries or not all(isinstance(entry, Mapping) for entry in entries):
        return None
    for keys in _LIST_KEYS:
        if all(keys[0] in entry for entry in entries) and len({_entry_key(entry, keys) for entry in entries}) == len(
            entries
        ):
            return keys
    return None


def _entry_key(entry: Mapping[str, Any], keys: tuple[str, ...]) -> tuple[Any, ...]:
    return tuple(entry.get(key, "TCP" if key == "protocol" else None) for key in keys)
