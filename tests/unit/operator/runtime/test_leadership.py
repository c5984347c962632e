"""Of several operators at most one may write, whatever fails."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from robot_offload.controller.clock import Clock
from robot_offload.kube.configuration import connect
from robot_offload.kube.errors import (
    AlreadyExistsError,
    ConflictError,
    NotConfiguredError,
    NotLeaderError,
    ServerFailedError,
)
from robot_offload.kube.kinds import CONFIG_MAP, Kind
from robot_offload.runtime.leadership import Leadership, LeadersOnly, Terms


class OneLease:
    """An API server that knows one Lease, with the preconditions of a real one."""

    def __init__(self) -> None:
        self.lease: dict[str, Any] | None = None
        self.broken = False
        self.version = 0

    async def get(self, kind: Kind, namespace: str | None, name: str) -> dict[str, Any] | None:
        self._check()
        return deepcopy(self.lease)

    async def create(self, manifest: dict[str, Any]) -> dict[str, Any]:
        self._check()
        if self.lease is not None:
            raise AlreadyExistsError("there is one")
        return self._store(manifest)

    async def patch(
        self, kind: Kind, namespace: str | None, name: str, patch: Mapping[str, Any], *, subresource: str = ""
    ) -> dict[str, Any]:
        self._check()
        assert self.lease is not None
        if patch["metadata"]["resourceVersion"] != self.lease["metadata"]["resourceVersion"]:
            raise ConflictError("changed meanwhile")
        return self._store({**self.lease, "spec": patch["spec"]})

    def _store(self, manifest: dict[str, Any]) -> dict[str, Any]:
        self.version += 1
        self.lease = deepcopy(manifest)
        self.lease["metadata"]["resourceVersion"] = str(self.version)
        return self.lease

    def _check(self) -> None:
        if self.broken:
            raise ServerFailedError("broken")

    @property
    def holder(self) -> str:
        assert self.lease is not None
        return str(self.lease["spec"]["holderIdentity"])


class World:
    """Candidates on one server; time stands still but for `now_s`."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.server = OneLease()

    def candidate(self, name: str) -> Leadership:
        clock = Clock(steady_s=lambda: self.now_s)
        return Leadership(self.server, "here", name, clock, Terms(15, 5, 10))  # type: ignore[arg-type]

    def tries(self, candidate: Leadership) -> bool:
        asyncio.run(candidate._try())
        return candidate.held


def test_the_first_one_leads_and_the_second_waits_until_the_lease_has_not_moved_for_its_time() -> None:
    world = World()
    first, second = world.candidate("a"), world.candidate("b")
    assert world.tries(first)
    assert not world.tries(second)
    world.now_s = 14
    assert not world.tries(second)
    world.now_s = 16
    assert world.tries(second)
    assert world.server.holder == "b"


def test_a_renewed_lease_is_never_taken() -> None:
    world = World()
    first, second = world.candidate("a"), world.candidate("b")
    for now_s in range(0, 100, 5):
        world.now_s = now_s
        assert world.tries(first)
        assert not world.tries(second)


def test_a_leader_that_cannot_renew_stops_writing_before_anybody_else_may_begin() -> None:
    world = World()
    first, second = world.candidate("a"), world.candidate("b")
    assert world.tries(first)
    assert not world.tries(second)
    world.now_s = 9.9
    assert first.held
    world.now_s = 10.1
    assert not first.held
    assert not world.tries(second)


def test_a_new_process_in_the_same_pod_goes_on_at_once() -> None:
    world = World()
    assert world.tries(world.candidate("a"))
    assert world.tries(world.candidate("a"))


def test_two_that_try_at_the_same_moment_do_not_both_win() -> None:
    world = World()
    first, second = world.candidate("a"), world.candidate("b")

    async def both() -> None:
        await asyncio.gather(first._try(), second._try())

    asyncio.run(both())
    assert [first.held, second.held].count(True) == 1


def test_a_released_lease_is_free_at_once() -> None:
    world = World()
    first, second = world.candidate("a"), world.candidate("b")
    assert world.tries(first)
    asyncio.run(first.release())
    assert not first.held
    assert world.tries(second)


def test_holding_ends_with_an_error_when_somebody_else_has_it() -> None:
    world = World()
    first = Leadership(world.server, "here", "a", Clock(lambda: world.now_s), Terms(15, 0.001, 10))  # type: ignore[arg-type]
    assert world.tries(first)
    assert world.server.lease is not None
    world.server.lease["spec"]["holderIdentity"] = "b"
    with pytest.raises(NotLeaderError, match="b is the leader now"):
        asyncio.run(first.hold())
    assert not first.held


def test_who_waits_names_the_holder_also_when_the_first_answer_was_lost() -> None:
    world = World()
    assert world.tries(world.candidate("a"))
    waiting = Leadership(world.server, "here", "b", Clock(lambda: world.now_s), Terms(15, 0.001, 10))  # type: ignore[arg-type]
    world.server.broken = True

    def holders() -> list[str]:
        return [line["holder"] for line in said if line["event"] == "Waiting for leadership"]

    async def until(wanted: list[str]) -> None:
        async with asyncio.timeout(60):
            while holders() != wanted:
                await asyncio.sleep(0.001)

    async def main() -> None:
        acquiring = asyncio.create_task(waiting.acquire())
        await until(["unknown"])
        world.server.broken = False
        await until(["unknown", "a"])
        acquiring.cancel()
        await asyncio.gather(acquiring, return_exceptions=True)

    with capture_logs() as said:
        asyncio.run(main())
    assert holders() == ["unknown", "a"], "each once, however often it has looked"


def test_who_does_not_lead_never_sends_a_write(tmp_path: Path) -> None:
    guard = LeadersOnly(World().candidate("a"))
    api = connect(str(tmp_path / "nowhere"), guard=guard)

    async def act() -> None:
        for write in (
            api.apply({}),
            api.create({}),
            api.patch(CONFIG_MAP, "here", "x", {}),
            api.delete(CONFIG_MAP, "here", "x", "u"),
            api.patch_status({}),
        ):
            with pytest.raises(NotLeaderError):
                await write
        with pytest.raises(NotConfiguredError):  # reading is tried
            await api.get(CONFIG_MAP, "here", "x")

    asyncio.run(act())
    assert guard.calls == {"get": 1, "apply": 1, "create": 1, "patch": 1, "delete": 1, "patch status": 1}
