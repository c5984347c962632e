"""The health check for Argo CD (docs/how-to/gitops.md), run in Lua on statuses as the operator writes them."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import pytest
from lupa.lua54 import LuaRuntime

from robot_offload.api.v1alpha1.status import CLOUD_TYPES
from robot_offload.decide.conditions import conditions
from robot_offload.decide.verdicts import Verdict, no, yes

SCRIPT = (Path(__file__).parents[3] / "manifests/argocd/health.lua").read_text(encoding="utf-8")
NOW = datetime.datetime(2026, 11, 21, tzinfo=datetime.UTC)
FINE = dict.fromkeys(CLOUD_TYPES, yes("Fine", "as declared")) | {"Connected": yes("Connected", "it is there")}


def health(status: dict[str, Any] | None, generation: int = 1, **spec: Any) -> tuple[str, str]:
    """What Argo CD shows for a RobotOffload: status and message."""
    lua = LuaRuntime(unpack_returned_tuples=True)
    resource: dict[str, Any] = {"metadata": {"generation": generation}, "spec": spec}
    if status is not None:
        resource["status"] = status
    lua.globals().obj = lua.table_from(resource, recursive=True)
    found = lua.execute(SCRIPT)
    return found.status, found.message


def status(generation: int = 1, **verdicts: Verdict) -> dict[str, Any]:
    found = conditions({**FINE, **verdicts}, (), generation, NOW)
    return {"observedGeneration": generation, "conditions": found}


def test_before_the_operator_has_looked_it_is_progressing() -> None:
    assert health(None)[0] == "Progressing"
    assert health({})[0] == "Progressing"
    assert health(status(1), generation=2)[0] == "Progressing"


def test_a_cloud_that_can_serve_is_healthy_wherever_the_robot_is() -> None:
    assert health(status())[0] == "Healthy"
    found, message = health(status(Connected=no("Disconnected", "in its dock")))
    assert (found, message) == ("Healthy", "Ready; the robot is not connected")


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ({"WorkloadsAvailable": no("PodsNotReady", "starting")}, "Progressing"),
        ({"ResourcesApplied": no("NameTaken", "somebody's")}, "Degraded"),
        ({"SpecValid": no("Required", "spec.nodes")}, "Degraded"),
    ],
)
def test_what_waits_for_somebody_is_degraded_and_what_waits_for_time_is_not(
    verdicts: dict[str, Verdict], expected: str
) -> None:
    found, message = health(status(**verdicts))
    assert found == expected
    (verdict,) = verdicts.values()
    assert verdict.reason in message


def test_what_is_switched_off_is_suspended() -> None:
    assert health(status(), replicas=0)[0] == "Suspended"
