"""Whether a topic has its declared type, and the same type on both sides."""

from __future__ import annotations

from collections.abc import Iterable

from robot_offload_core.words.reasons import Reason


def same_type(one: str, other: str) -> bool:
    """Return whether two types are the same: by name, and by hash if both have one."""
    names, hashes = zip(*((text.partition(" ")[0], text.partition(" ")[2]) for text in (one, other)), strict=True)
    return names[0] == names[1] and ("" in hashes or hashes[0] == hashes[1])


def otherwise(topic: str, declared: str, found: Iterable[tuple[str, str]]) -> tuple[str, str] | None:
    """Return the problem, (reason, message), of a topic that is published with another type than declared, or None.

    Args:
        topic: public or private name.
        declared: interface type of the configuration; "auto": any.
        found: (node, interface type) of each publisher in the graph; node "" while its name is unknown.
    """
    others = sorted({(node, kind) for node, kind in found if kind != declared})
    if declared == "auto" or not others:
        return None
    who = ", ".join(f"{node or 'somebody'} publishes {kind}" for node, kind in others)
    return (
        Reason.TYPES_DIFFER.value,
        f"{topic} is declared as {declared}, but {who}: correct the declaration or the node",
    )
