"""The only Lease that this process may write, through the project's API adapter."""

from __future__ import annotations

from typing import Any, Final, Protocol

from robot_offload.kube.configuration import connect
from robot_offload.kube.kinds import LEASE
from robot_offload.kube.retry import RetryPolicy

WRITE_WITHIN_S: Final = 8.0
"""Limit of one write, with its connection: shorter than a Lease, so that a hanging server is retried in time."""


class Leases(Protocol):
    """The target of the mirrored state."""

    async def write(self, patch: dict[str, Any]) -> None:
        """Merge `patch` into the Lease.

        Raises:
            RobotOffloadError: it was not written; the next attempt may succeed.
        """

    async def close(self) -> None:
        """End the connection."""


class ClusterLease:
    """The Lease on the API server. Each write is tried once: the mirror decides when to retry, and with what."""

    def __init__(self, namespace: str, name: str) -> None:
        self._namespace = namespace
        self._name = name
        self._api = connect(retry=RetryPolicy(attempts=1, request_timeout_s=WRITE_WITHIN_S))

    async def write(self, patch: dict[str, Any]) -> None:
        """Merge `patch` into the Lease."""
        await self._api.patch(LEASE, self._namespace, self._name, patch)

    async def close(self) -> None:
        """End the connection."""
        await self._api.close()
