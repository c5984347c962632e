"""In which order the children of one plan are written."""

from __future__ import annotations

import asyncio
from typing import Any, cast

from robot_offload.controller.apply import carry_out
from robot_offload.controller.clock import Clock
from robot_offload.controller.store import Store
from robot_offload.decide.plan import Apply, History, Plan
from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, ROLE, ROLE_BINDING, Kind
from robot_offload.kube.port import KubeApi, Manifest


class SlowApiDouble:
    """An API server double that answers late; it notes what was there when a write arrived."""

    def __init__(self) -> None:
        self.there: set[str] = set()
        self.before: dict[str, frozenset[str]] = {}

    async def apply(self, manifest: Manifest, *, force: bool = False) -> Manifest:
        kind = str(manifest["kind"])
        self.before[kind] = frozenset(self.there)
        for _ in range(5):
            await asyncio.sleep(0)
        self.there.add(kind)
        return {**manifest, "metadata": {**manifest["metadata"], "uid": kind, "resourceVersion": "1"}}


def child(kind: Kind) -> Apply:
    metadata: dict[str, Any] = {"name": "walker-agent", "namespace": "robots"}
    return Apply({"apiVersion": kind.api_version, "kind": kind.kind, "metadata": metadata}, force=False)


def test_a_role_binding_waits_for_its_role_and_pods_wait_for_both() -> None:
    api = SlowApiDouble()
    wanted = Plan(tuple(map(child, (DEPLOYMENT, ROLE_BINDING, CONFIG_MAP, ROLE))))
    done = asyncio.run(carry_out(cast(KubeApi, api), Store(), wanted, {}, History(), Clock()))
    assert done.writes == 4
    assert api.before == {
        "ConfigMap": frozenset(),
        "Role": frozenset(),
        "RoleBinding": {"ConfigMap", "Role"},
        "Deployment": {"ConfigMap", "Role", "RoleBinding"},
    }
