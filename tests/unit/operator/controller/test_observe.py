"""What is read before a write, with the rights that the chart gives by default."""

from __future__ import annotations

import asyncio
from typing import cast

import pytest

from robot_offload.controller.observe import Observer, Snapshot
from robot_offload.controller.store import Store
from robot_offload.kube.errors import ForbiddenError
from robot_offload.kube.kinds import CERTIFICATE, SERVICE, Kind
from robot_offload.kube.port import KubeApi, Manifest
from tests.unit.operator.render.given import offload


class RefusingApiDouble:
    """An API server double that gives no right to read some kinds."""

    def __init__(self, *refused: Kind) -> None:
        self.refused = refused

    async def get(self, kind: Kind, namespace: str, name: str) -> Manifest | None:
        if kind in self.refused:
            raise ForbiddenError(f"cannot get {kind.kind} {namespace}/{name}")
        return None


def confirm(*refused: Kind) -> Snapshot:
    seen = Snapshot()
    observer = Observer(cast("KubeApi", RefusingApiDouble(*refused)), Store(), "robots", offload())
    asyncio.run(observer.confirm(seen, [(CERTIFICATE, "walker-cloud"), (SERVICE, "walker-udp")]))
    return seen


def test_without_rights_on_cert_manager_everything_else_is_still_made() -> None:
    assert confirm(CERTIFICATE).fresh == {(CERTIFICATE, "walker-cloud"), (SERVICE, "walker-udp")}


def test_without_rights_on_our_own_kinds_nothing_is_taken_for_missing() -> None:
    with pytest.raises(ForbiddenError):
        confirm(SERVICE)
