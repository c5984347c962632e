"""Whatever breaks a pass ends in a condition with its text and the next step, never in silence."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable
from typing import Any

import pytest

from robot_offload.controller import certify, reconcile, steps
from robot_offload.controller.failures import Step
from robot_offload.controller.reconcile import Controller, Result
from robot_offload.controller.tools import Policy
from robot_offload.errors import InputError
from robot_offload.kube.configuration import connect
from robot_offload.kube.kinds import DEPLOYMENT, LEASE, ROBOT_OFFLOAD
from robot_offload.objects.facts import Images
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import Place, eventually, walker

pytestmark = pytest.mark.api
IMAGES = Images(agent="agent:1", operator="operator:1", discovery="discovery:1", router="router:1")
BUILD = {"git": {"url": "https://git.example/talker.git"}, "packages": ["talker"]}
BROKEN_IN: dict[Step, tuple[Any, str]] = {
    Step.READ: (reconcile, "check"),
    Step.OBSERVE: (steps.observe.Observer, "cluster"),
    Step.SECRETS: (certify.certificates, "issue"),
    Step.BUILDS: (steps.Pass, "_builds"),
    Step.DISCOVERY: (steps.discovery, "hosts"),
    Step.RENDER: (steps, "children"),
    Step.APPLY: (steps.Pass, "_prunable"),
    Step.JUDGE: (steps.agent, "placement"),
}


def one_pass(plane: ControlPlane, namespace: str, passes: int = 1) -> Result:
    """Runs passes of the real controller against the real API server, in this process so that steps can be broken."""

    async def main() -> Result:
        api = connect(str(plane.kubeconfig))
        try:
            controller = Controller(api, IMAGES, policy=Policy(home="default"))
            for _ in range(passes - 1):
                await controller.reconcile((namespace, "walker"))
            return await controller.reconcile((namespace, "walker"))
        finally:
            await api.close()

    return asyncio.run(main())


def raising(error: Exception) -> Callable[..., Any]:
    def broken(*_: Any, **__: Any) -> Any:
        raise error

    return broken


@pytest.mark.parametrize("step", Step)
def test_a_step_that_breaks_says_so_in_the_status(
    control_plane: ControlPlane, namespace: str, monkeypatch: pytest.MonkeyPatch, step: Step
) -> None:
    place = Place(control_plane, namespace)
    place.create(ROBOT_OFFLOAD, walker())
    with monkeypatch.context() as patched:
        patched.setattr(*BROKEN_IN[step], raising(ZeroDivisionError("a slip")))
        assert one_pass(control_plane, namespace).failed
    for name in ("ResourcesApplied", "Ready"):
        condition = place.condition(name)
        assert (condition["status"], condition["reason"]) == ("Unknown", "OperatorBug"), condition
        assert "ZeroDivisionError: a slip" in condition["message"]
        assert step.value in condition["message"]
    one_pass(control_plane, namespace)
    place.wait_condition("ResourcesApplied", "True")


def test_what_cannot_be_rendered_is_the_users_to_correct(
    control_plane: ControlPlane, namespace: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Place(control_plane, namespace)
    place.create(ROBOT_OFFLOAD, walker())
    monkeypatch.setattr(steps, "children", raising(InputError("spec.x: write y instead")))
    one_pass(control_plane, namespace)
    condition = place.wait_condition("ResourcesApplied", "False", "CannotRender")
    assert "write y instead" in condition["message"]


def test_a_flood_of_text_from_the_robot_does_not_keep_the_status_from_being_written(
    place: Place,
) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    place.renew("cloud", "LinkGood")
    eventually(lambda: place.roff()["status"]["placement"] == "Cloud", "the cloud to act")
    place.renew("robot", "x" * 400)
    eventually(lambda: place.roff()["status"]["placementReason"] == "Unreadable", "the reason to be replaced")
    assert place.roff()["status"]["placement"] == "Robot"
    state = {"version": 1, "connected": True, "site": "cloud", "settings": {"robot_generation": 10**30}}
    annotations = {"robotoffload.dev/state": json.dumps(state)}
    place.patch(LEASE, "walker-robot", {"metadata": {"annotations": annotations}})
    eventually(lambda: place.roff()["status"]["placement"] == "Unknown", "the state to be refused")
    assert "too large" in place.roff()["status"]["placementMessage"]
    place.renew("cloud", "LinkGood")
    eventually(lambda: place.roff()["status"]["placement"] == "Cloud", "the status to follow again")


def test_a_rival_that_sets_our_fields_again_and_again_is_named_and_fought_ever_less_often(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    over = threading.Event()

    def rival() -> None:
        while not over.wait(0.2):
            place.patch(DEPLOYMENT, "walker-talker", {"spec": {"minReadySeconds": 77}})

    thread = threading.Thread(target=rival)
    thread.start()
    try:
        condition = place.wait_condition("ResourcesApplied", "False", "Contested")
        assert "'somebody'" in condition["message"]
        generation = place.there(DEPLOYMENT, "walker-talker")["metadata"]["generation"]
        over.wait(5.0)
        taken_back = place.there(DEPLOYMENT, "walker-talker")["metadata"]["generation"] - generation
        assert taken_back <= 2, "no taking-back in a pause of 30 s, and one when it ends"
    finally:
        over.set()
        thread.join()
