"""Reads and writes the keys of one RobotOffload's authorities, in the operator's own namespace."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

import structlog

from robot_offload.controller.apply import Applied, carry_out
from robot_offload.controller.memory import Memory
from robot_offload.controller.observe import Observer, Snapshot
from robot_offload.controller.subject import Subject
from robot_offload.controller.tools import Tools
from robot_offload.decide import authorities
from robot_offload.decide.certificates import REVOKED, SPENT, Role
from robot_offload.decide.ownership import Key, belongs, key_of
from robot_offload.decide.plan import plan
from robot_offload.kube.kinds import SECRET
from robot_offload.kube.port import Manifest
from robot_offload.objects.parent import Parent

_log = structlog.get_logger("robot_offload.controller")


class Authorities:
    """The authorities of one pass.

    Args:
        tools: shared by all passes.
        subject: of the pass.
        memory: of the subject.
        observer: reads for this pass.
        snapshot: what was read beside the robot.
        note: receives the result of each write.
    """

    def __init__(
        self,
        tools: Tools,
        subject: Subject,
        memory: Memory,
        observer: Observer,
        snapshot: Snapshot,
        note: Callable[[Applied], None],
    ) -> None:
        self._tools = tools
        self._subject = subject
        self._memory = memory
        self._observer = observer
        self._snapshot = snapshot
        self._note = note
        self._home = tools.policy.home
        self._names = authorities.secret_names(subject.uid)
        self._live: dict[Key, Manifest] = {}

    def known(self) -> list[tuple[str, str]]:
        """Return uid and version of those known from the watch."""
        entries = [self._tools.store.entry(SECRET, self._home, name) for name in self._names.values()]
        return [(entry.uid, entry.version) for entry in entries if entry is not None]

    def preread(self) -> dict[Role, Manifest | None]:
        """Return them as read at the operator's start, if they have not changed since."""
        take = self._tools.preread.take
        return {role: take(self._tools.store, self._home, name) for role, name in self._names.items()}

    async def read(self) -> dict[Role, Manifest | None]:
        """Read them from the API server, because the store keeps no keys."""
        found = await asyncio.gather(*(self._tools.api.get(SECRET, self._home, name) for name in self._names.values()))
        self._live = {key_of(one): one for one in found if one is not None}
        uid = self._subject.uid
        return {
            role: one if one is not None and belongs(one, uid) else None
            for role, one in zip(self._names, found, strict=True)
        }

    async def apply(self, wanted: Iterable[Manifest]) -> Applied:
        """Write those that differ from the ones read."""
        history, clock = self._memory.authorities, self._tools.clock
        steps = plan(wanted, self._live, self._subject.uid, history=history, now_s=clock.steady_s())
        applied = await carry_out(self._tools.api, self._tools.store, steps, self._live, history, clock)
        self._note(applied)
        return applied

    def identity(self) -> str:
        """Return the uid by which the robot knows its cloud; empty: the RobotOffload's uid."""
        name = self._names["server-ca"]
        known = self._live.get((SECRET, name)) or self._tools.store.get(SECRET, self._home, name)
        return authorities.identity_of(known)

    async def adopt(self, parent: Parent) -> bool:
        """Adopt the keys of an earlier RobotOffload of this name; return whether there were any.

        Only if this one has no keys yet. The earlier Secrets are deleted once all is copied: a key is in one place.
        """
        if not self._tools.policy.adopt:
            return False
        old = authorities.heritage(await self._secrets(), parent)
        if not old:
            return False
        names = authorities.secret_names(old)
        found = {role: await self._tools.api.get(SECRET, self._home, name) for role, name in names.items()}
        there = {role: secret for role, secret in found.items() if secret is not None}
        if len(there) < len(names):
            return False
        identity = authorities.identity_of(there["server-ca"]) or old
        copies = []
        for role, secret in there.items():
            annotations = secret["metadata"].get("annotations") or {}
            noted = {name: annotations[name] for name in (REVOKED, SPENT) if name in annotations}
            own = {authorities.IDENTITY: identity} if role == "server-ca" else noted
            copies.append(authorities.secret(parent, role, secret.get("data") or {}, own))
        applied = await self.apply(copies)
        if not applied.complete:
            return False
        for secret in there.values():
            await self._tools.api.delete(SECRET, self._home, secret["metadata"]["name"], secret["metadata"]["uid"])
        _log.info("Went on with the authorities of an earlier RobotOffload", **self._subject.words, identity=identity)
        return True

    async def _secrets(self) -> list[Manifest]:
        """Return the Secrets in the operator's namespace that may be authorities, without their keys if possible."""
        if self._tools.store.fed:
            return [entry.manifest() for _, entry in self._tools.store.entries(SECRET, self._home)]
        return await self._tools.api.list(SECRET, self._home, authorities.LABELS)

    async def take_over(self, parent: Parent) -> frozenset[Key]:
        """Copy what an earlier version kept beside the robot; return the Secrets there that must stay.

        Only for a RobotOffload that an operator has handled before; the Secrets beside a new one have another owner.
        """
        former = authorities.former_keys(parent.name)
        uid = self._subject.uid
        there = {role: key for role, key in former.items() if self._snapshot.ours(*key, uid) is not None}
        if not there or not self._subject.status.get("observedGeneration"):
            return frozenset()
        await self._observer.confirm(self._snapshot, there.values())
        here, copies = await self.read(), []
        for role, key in there.items():
            old = self._snapshot.ours(*key, uid)
            if here[role] is None and old is not None:
                annotations = old["metadata"].get("annotations") or {}
                noted = {REVOKED: annotations[REVOKED]} if REVOKED in annotations else {}
                copies.append(authorities.secret(parent, role, old.get("data") or {}, noted))
        applied = await self.apply(copies)
        if not applied.complete:
            return frozenset(there.values())
        _log.info("Moved authorities to the operator's namespace", **self._subject.words, copied=len(copies))
        return frozenset()
