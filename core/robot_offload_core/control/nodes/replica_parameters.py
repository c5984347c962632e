"""Whether the two replicas of a node have the same parameters: names and values, compared by their digests. Pure.

Each side states one digest for all parameters of each of its duplicated nodes. Only if the digests of a node differ,
one digest per parameter is stated, until the other side has them. So equal parameters cost next to nothing, and no
value leaves its side.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from robot_offload_core.fence.token import Site
from robot_offload_core.words.parameters import MAX_SHOWN, PRIVATE_TOPICS
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.replace import replace

ALWAYS_DIFFER = ("qos_overrides.*",)
"""Names that contain a topic name, which differs between the sides."""
DIGEST_LENGTH = 8
MAX_NODES = 128
MAX_STATED = 512
"""Most parameters of one node that are stated one by one: the first ones by name."""
READ_PERIOD_S = 5.0
"""How often a node's parameters are read."""
HASTY_PERIOD_S = 1.0
"""The same while they differ: most differences vanish once the other replica has started."""

Table = Mapping[str, str]
"""Digest of the value of each parameter, by its name."""


@dataclass(frozen=True)
class Statement:
    """One side's statement about one of its nodes.

    Attributes:
        digest: of all parameters; "" while they are unknown.
        has: digest of the newest table that this side has received for the other side's node; "" for none.
        table: the parameters one by one; None while the other side does not need them.
    """

    digest: str = ""
    has: str = ""
    table: Table | None = None


@dataclass(frozen=True)
class Compared:
    """State of one side.

    Attributes:
        own: parameters read from the nodes here.
        stated: the other side's newest statement on each node.
        tables: (digest, parameters) of those nodes of the other side whose parameters were stated one by one.
    """

    own: Mapping[str, Table] = field(default_factory=dict)
    stated: Mapping[str, Statement] = field(default_factory=dict)
    tables: Mapping[str, tuple[str, Table]] = field(default_factory=dict)


def value_digest(value: object, side: Site) -> str:
    """Return the digest of a value; the private topics of both sides count as one name."""
    text = repr(value).replace(PRIVATE_TOPICS.format(side.value), PRIVATE_TOPICS.format("*"))
    return _digest(text)


def counts(name: str, may_differ: Iterable[str]) -> bool:
    """Return whether a parameter is compared; `*` in an exception matches any text."""
    return not any(fnmatchcase(name, pattern) for pattern in (*ALWAYS_DIFFER, *may_differ))


def table_digest(table: Table) -> str:
    """Return the digest of all parameters of a node."""
    return _digest(repr(sorted(table.items())))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode(errors="replace")).hexdigest()[:DIGEST_LENGTH]


def read(compared: Compared, node: str, table: Table | None) -> Compared:
    """Take the parameters of a node here; None if it does not answer."""
    others = {name: known for name, known in compared.own.items() if name != node}
    return replace(compared, own=others if table is None else {**others, node: table})


def heard(compared: Compared, stated: Mapping[str, Statement]) -> Compared:
    """Take the statements of the other side."""
    tables = {name: known for name, known in compared.tables.items() if name in stated}
    tables |= {name: (said.digest, said.table) for name, said in stated.items() if said.table is not None}
    return replace(compared, stated=stated, tables=tables)


def statements(compared: Compared) -> dict[str, Statement]:
    """Return the statements for the other side; only one node at a time has its parameters one by one."""
    found: dict[str, Statement] = {}
    free = True
    for node, table in sorted(compared.own.items())[:MAX_NODES]:
        digest, said = table_digest(table), compared.stated.get(node, Statement())
        wanted = free and said.digest not in ("", digest) and said.has != digest
        free = free and not wanted
        listed = dict(sorted(table.items())[:MAX_STATED]) if wanted else None
        found[node] = Statement(digest, compared.tables.get(node, ("", {}))[0], listed)
    return found


def unlike(compared: Compared, node: str) -> bool:
    """Return whether the digests of a node differ, so that it is read again soon."""
    said = compared.stated.get(node)
    table = compared.own.get(node)
    return said is not None and table is not None and said.digest not in ("", table_digest(table))


def differences(compared: Compared, alike: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the names of the parameters that differ, by node.

    Args:
        compared: the state.
        alike: nodes whose replicas are in the same lifecycle state. Only for these, a parameter that just one replica
            has counts: many nodes declare parameters while they are configured or activated.
    """
    found: dict[str, tuple[str, ...]] = {}
    in_one_state = set(alike)
    for node, (digest, theirs) in compared.tables.items():
        ours, said = compared.own.get(node), compared.stated.get(node)
        if ours is None or said is None or said.digest != digest or table_digest(ours) == digest:
            continue
        last = max(theirs, default="") if len(theirs) >= MAX_STATED else None
        both = {name for name in ours if name in theirs and ours[name] != theirs[name]}
        alone = {name for name in ours.keys() ^ theirs.keys() if last is None or name <= last}
        names = both | alone if node in in_one_state else both
        if names:
            found[node] = tuple(sorted(names))
    return found


def problem(found: Mapping[str, tuple[str, ...]]) -> tuple[Reason, str] | None:
    """Return (reason, message) for the differences; None if there are none."""
    if not found:
        return None
    parts = []
    for node, names in found.items():
        more = f" and {len(names) - MAX_SHOWN} more" if len(names) > MAX_SHOWN else ""
        parts.append(f"{node} ({', '.join(names[:MAX_SHOWN])}{more})")
    message = f"Parameters differ between the two replicas of {'; '.join(parts)}"
    return Reason.REPLICA_PARAMETERS_DIFFER, message
