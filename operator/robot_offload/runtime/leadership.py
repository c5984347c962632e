"""Who may write: the holder of one Lease. Of two operators at once the second waits.

The holder renews; others measure on their own steady clock how long the Lease has not moved. A holder that could not
renew for a while stops writing before another operator can start, and ends its process: a restart is the clean way
back. The identity is the pod's name: a container that was killed and restarts in the same pod takes over from itself at
once, because its predecessor is surely dead.
"""

from __future__ import annotations

import asyncio
import datetime
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.kube.errors import ConflictError, KubeError, NotLeaderError
from robot_offload.kube.kinds import LEASE
from robot_offload.kube.port import READS, KubeApi, Manifest, Verb

LEASE_NAME: Final = "robot-offload-operator"
_log = structlog.get_logger("robot_offload.leadership")


@dataclass(frozen=True, slots=True)
class Terms:
    """The times of a Lease, in seconds.

    Attributes:
        duration_s: time after which others may take over.
        renew_s: period of the holder's renewals.
        give_up_s: without a renewal for this long the holder stops writing; less than `duration_s`.
    """

    duration_s: float = 15.0
    renew_s: float = 5.0
    give_up_s: float = 10.0


class Leadership:
    """One candidate."""

    def __init__(
        self, api: KubeApi, namespace: str, identity: str, clock: Clock | None = None, terms: Terms | None = None
    ) -> None:
        self._api = api
        self._namespace = namespace
        self._identity = identity
        self._clock = clock or Clock()
        self._terms = terms or Terms()
        self._until_s = float("-inf")
        self._seen = ""
        self._moved_s = self._clock.steady_s()
        self.looked_s = self._moved_s
        """The loop's last turn, on the steady clock: shows that it lives."""

    @property
    def held(self) -> bool:
        """Whether this process may write now."""
        return self._clock.steady_s() < self._until_s

    def alive(self) -> float:
        """Record that the loop lives; return the steady clock."""
        self.looked_s = self._clock.steady_s()
        return self.looked_s

    async def acquire(self) -> None:
        """Wait until this process is the leader."""
        told = ""
        while True:
            try:
                holder = await self._try()
            except KubeError as error:
                _log.warning("Could not reach the leader's Lease", error=str(error))
                holder = told or "unknown"
            if self.held:
                _log.info("Became leader", identity=self._identity)
                return
            if holder != told:
                _log.info("Waiting for leadership", holder=holder, identity=self._identity)
                told = holder
            await asyncio.sleep(self._terms.renew_s / 2)

    async def hold(self) -> None:
        """Renew until an error.

        Raises:
            NotLeaderError: another operator has it, or it could not be renewed in time.
        """
        pause_s = self._terms.renew_s
        while True:
            await asyncio.sleep(pause_s)
            try:
                holder = await self._try()
                pause_s = self._terms.renew_s
            except KubeError as error:
                _log.warning("Could not renew the leader's Lease", error=str(error))
                holder, pause_s = self._identity, min(1.0, self._terms.renew_s / 4)
            if holder != self._identity:
                self._until_s = float("-inf")
                raise NotLeaderError(f"{holder} is the leader now")
            if not self.held:
                raise NotLeaderError(f"the leader's Lease could not be renewed for {self._terms.give_up_s:g} s")

    async def release(self) -> None:
        """Let the next leader start at once; best effort."""
        if not self.held:
            return
        self._until_s = float("-inf")
        try:
            lease = await self._api.get(LEASE, self._namespace, LEASE_NAME)
            if lease and (lease.get("spec") or {}).get("holderIdentity") == self._identity:
                await self._write(lease, "")
        except KubeError as error:
            _log.info("Could not release the leader's Lease", error=str(error))

    def check(self) -> None:
        """Raise `NotLeaderError` unless this process may write now."""
        if not self.held:
            raise NotLeaderError("this operator is not the leader")

    async def _try(self) -> str:
        """Try once to take or renew the Lease; return its holder."""
        began_s = self.alive()
        lease = await self._api.get(LEASE, self._namespace, LEASE_NAME)
        try:
            if lease is None:
                await self._api.create(self._lease({}, self._identity))
            else:
                holder = (lease.get("spec") or {}).get("holderIdentity") or ""
                if holder not in ("", self._identity) and not self._expired(lease):
                    return str(holder)
                await self._write(lease, self._identity)
        except ConflictError:
            return "another operator"
        # Counted from before the request: the Lease may have been written at once and the answer delayed.
        self._until_s = began_s + self._terms.give_up_s
        return self._identity

    def _expired(self, lease: Manifest) -> bool:
        version = str(lease["metadata"].get("resourceVersion"))
        now_s = self._clock.steady_s()
        if version != self._seen:
            self._seen, self._moved_s = version, now_s
        duration_s = float((lease.get("spec") or {}).get("leaseDurationSeconds") or self._terms.duration_s)
        return now_s - self._moved_s > duration_s

    async def _write(self, lease: Manifest, holder: str) -> None:
        spec = lease.get("spec") or {}
        patch = {
            "metadata": {"resourceVersion": lease["metadata"]["resourceVersion"]},
            "spec": self._lease(spec, holder)["spec"],
        }
        await self._api.patch(LEASE, self._namespace, LEASE_NAME, patch)

    def _lease(self, before: Mapping[str, Any], holder: str) -> Manifest:
        now = self._clock.wall().astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        changed = before.get("holderIdentity") != holder
        return {
            "apiVersion": LEASE.api_version,
            "kind": LEASE.kind,
            "metadata": {"name": LEASE_NAME, "namespace": self._namespace},
            "spec": {
                "holderIdentity": holder,
                "leaseDurationSeconds": round(self._terms.duration_s),
                "renewTime": now,
                "acquireTime": now if changed else before.get("acquireTime", now),
                "leaseTransitions": int(before.get("leaseTransitions") or 0) + changed,
            },
        }


class LeadersOnly:
    """Guards a client: counts its requests, and refuses to write unless this process is the leader."""

    def __init__(self, leadership: Leadership) -> None:
        self._leadership = leadership
        self.calls: Counter[str] = Counter()

    def __call__(self, verb: Verb) -> None:
        """Count a request before it is sent.

        Raises:
            NotLeaderError: it writes, and this process is not the leader.
        """
        self.calls[verb] += 1
        if verb not in READS:
            self._leadership.check()
