"""Whether the operator still sees and still leads. A process that only seems alive is worse than a dead one.

The watch is judged from outside: a list gives the version of every RobotOffload, and if the watch has not delivered it
some time later, the watch is blind, regardless of its connection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from robot_offload.kube.port import Manifest


@dataclass(slots=True)
class WatchSight:
    """The watch's deliveries, compared with lists.

    Attributes:
        seen: the newest resourceVersion by uid that the watch has delivered.
        behind: by uid: which version is missing, and since when (steady clock).
    """

    seen: dict[str, str] = field(default_factory=dict)
    behind: dict[str, tuple[str, float]] = field(default_factory=dict)

    def delivered(self, manifest: Manifest, *, gone: bool = False) -> None:
        """Record that the watch has delivered an event."""
        uid = manifest["metadata"]["uid"]
        if gone:
            self.seen.pop(uid, None)
            self.behind.pop(uid, None)
            return
        self.seen[uid] = manifest["metadata"]["resourceVersion"]
        missing = self.behind.get(uid)
        if missing is not None and not _older(self.seen[uid], missing[0]):
            del self.behind[uid]

    def listed(self, manifests: Iterable[Manifest], now_s: float) -> list[Manifest]:
        """Compare with a list; return the objects that the watch has not yet delivered in this version."""
        late: list[Manifest] = []
        present = set()
        for manifest in manifests:
            uid, version = manifest["metadata"]["uid"], manifest["metadata"]["resourceVersion"]
            present.add(uid)
            if not _older(self.seen.get(uid), version):
                self.behind.pop(uid, None)
                continue
            late.append(manifest)
            # The oldest missing version counts: newer ones must not make the watch look fresh.
            self.behind.setdefault(uid, (version, now_s))
        for uid in set(self.behind) - present:
            del self.behind[uid]
        for uid in set(self.seen) - present:
            del self.seen[uid]
        return late

    def blind_s(self, now_s: float) -> float:
        """Return for how many seconds something has been missing; 0: nothing."""
        return max((now_s - since_s for _, since_s in self.behind.values()), default=0.0)


def _older(seen: str | None, version: str) -> bool:
    """Return whether the seen version is older than `version`. Versions are numbers wherever Kubernetes runs."""
    if seen is None:
        return True
    try:
        return int(seen) < int(version)
    except ValueError:
        return seen != version


@dataclass(frozen=True, slots=True)
class Limit:
    """One sign of life.

    Attributes:
        name: for the answer of /livez.
        age_s: its age.
        limit_s: its maximum age.
    """

    name: str
    age_s: float
    limit_s: float

    @property
    def kept(self) -> bool:
        """Whether its age is within the limit."""
        return self.age_s <= self.limit_s


Signs = Callable[[], Iterable[Limit]]
"""Gathers the signs of life."""


def healthy(signs: Iterable[Limit]) -> tuple[bool, dict[str, str]]:
    """Return whether all signs are recent enough, and each in words."""
    found = list(signs)
    told = {
        sign.name: f"{sign.age_s:.1f} s of at most {sign.limit_s:g} s{'' if sign.kept else ': too old'}"
        for sign in found
    }
    return all(sign.kept for sign in found), told
