"""What others add to the operator's objects is taken back or named, on a real API server."""

from __future__ import annotations

import pytest

from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, ROBOT_OFFLOAD, ROLE_BINDING, SERVICE
from tests.integration.operator_cluster import Place, eventually, walker

pytestmark = pytest.mark.api


def test_foreign_entries_in_selectors_and_subjects_are_taken_back(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    selector = place.there(SERVICE, "walker-udp")["spec"]["selector"]
    subjects = place.there(ROLE_BINDING, "walker-agent")["subjects"]
    place.patch(SERVICE, "walker-udp", {"spec": {"selector": {"app": "evil"}}})
    eve = {"kind": "User", "name": "eve", "apiGroup": "rbac.authorization.k8s.io"}
    place.patch(ROLE_BINDING, "walker-agent", {"subjects": [*subjects, eve]})
    eventually(lambda: place.there(SERVICE, "walker-udp")["spec"]["selector"] == selector, "our selector")
    eventually(lambda: place.there(ROLE_BINDING, "walker-agent")["subjects"] == subjects, "our subjects")


def test_foreign_containers_host_namespaces_and_files_are_named(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = place.there(DEPLOYMENT, "walker-agent")["spec"]["template"]["spec"]["containers"]
    pod = {"hostNetwork": True, "containers": [*before, {"name": "evil", "image": "registry.example/evil:1"}]}
    place.patch(DEPLOYMENT, "walker-agent", {"spec": {"template": {"spec": pod}}})
    place.patch(CONFIG_MAP, "walker-agent", {"data": {"evil.yaml": "a: b"}})

    def message() -> str:
        return str(place.wait_condition("ResourcesApplied", "True")["message"])

    for word in ("hostNetwork", "container evil", "ConfigMap walker-agent: key evil.yaml"):
        eventually(lambda word=word: word in message(), word, message)  # type: ignore[misc]  # the loop's own value
    assert place.condition("ResourcesApplied")["reason"] == "AppliedWithAdditions"
