"""The pods of pools: found in the graph by the private names that they serve; they ask to leave by files.

A pod that is to end asks by a file named after its member in `leaving/` of the runtime folder. It then waits for the
file of the same name in `left/`: from then on it has no open call and gets no more.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable
from pathlib import Path

from robot_offload_agent.relay.entities import Owner, ServiceClient
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.served import member_in
from robot_offload_core.relay.pools import Pools
from robot_offload_core.words.declared import ServiceSpec

log = logging.getLogger(__name__)

KEPT_S = 10.0
"""A client whose pod does not answer in the graph is kept this long: discovery finds a pod's parts one by one."""


class Members:
    """The members of all pools: their clients, and those that leave.

    Attributes:
        specs: the pooled services.
        clients: by (service, member).
        seen_s: when a client's server was last in the graph, or the client was made.
    """

    def __init__(self, owner: Owner, specs: Iterable[ServiceSpec], runtime_dir: str | Path) -> None:
        self.owner = owner
        self.specs = [spec for spec in specs if spec.pooled]
        self.clients: dict[tuple[str, str], ServiceClient] = {}
        self.seen_s: dict[tuple[str, str], float] = {}
        self.leaving_dir, self.left_dir = Path(runtime_dir) / "leaving", Path(runtime_dir) / "left"

    def look(self, pools: Pools) -> bool:
        """Report pods that serve and pods that leave; return whether none of them is coming or going."""
        now, complete = now_s(), True
        names = [name for name, _ in self.owner.node.get_service_names_and_types()] if self.specs else []
        for spec in self.specs:
            self._find(spec, names, now)
            seen = self._seen(spec.name, now)
            pools.seen(spec.name, seen)
            complete = complete and len(seen) == sum(1 for name, _ in self.clients if name == spec.name)
        self._forget(now)
        return self._let_go(pools) and complete

    def _find(self, spec: ServiceSpec, names: Iterable[str], now: float) -> None:
        for name in names:
            member = member_in(name, spec.name)
            if member is not None and (spec.name, member) not in self.clients:
                self.clients[spec.name, member] = ServiceClient(self.owner, name, spec.type)
                self.seen_s[spec.name, member] = now

    def _seen(self, service: str, now: float) -> dict[str, str]:
        found = {}
        for (name, member), client in self.clients.items():
            endpoints = client.endpoints() if name == service else ""
            if endpoints:
                found[member] = endpoints
                self.seen_s[name, member] = now
        return found

    def _forget(self, now: float) -> None:
        """Drop clients whose pods are gone: this process's own part in the graph would name the pod for ever."""
        for place in [place for place, seen_s in self.seen_s.items() if now - seen_s > KEPT_S]:
            del self.seen_s[place]
            raw = self.clients.pop(place).raw
            self.owner.loop.clients.remove(raw)
            self.owner.node.destroy_client(raw.entity)

    def _let_go(self, pools: Pools) -> bool:
        """Read which pods ask to leave, and answer those without an open call; return whether all are answered."""
        asked = _names(self.leaving_dir)
        free = set(pools.leave(asked))
        answered = _names(self.left_dir)
        try:
            for member in free - answered:
                self.left_dir.mkdir(exist_ok=True)
                (self.left_dir / member).touch()
                log.info("A pod of a pool has no open call and may go member=%s", member)
            for member in answered - asked:
                (self.left_dir / member).unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be written, so pods wait longer before they end: %s", self.left_dir, error)
        return asked <= free


def _names(folder: Path) -> set[str]:
    with contextlib.suppress(OSError):
        return {file.name for file in folder.iterdir()}
    return set()
