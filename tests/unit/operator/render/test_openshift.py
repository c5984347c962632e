"""With `cloud.runAsUser: null` every pod keeps to OpenShift's security context constraint `restricted-v2`.

Its rules, as the OpenShift Container Platform 4.16 ships them: user ids and groups are the namespace's, so a pod names
none; all capabilities are dropped; no privilege escalation, nothing of the host, seccomp `runtime/default`; these kinds
of volumes only. The API server's own Pod Security levels do not look at user ids.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.kube.port import Manifest
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, facts, resource

VOLUMES = {
    "configMap", "csi", "downwardAPI", "emptyDir", "ephemeral", "persistentVolumeClaim", "projected", "secret",
}  # fmt: skip
NUMBERS = {"runAsUser", "runAsGroup", "fsGroup", "supplementalGroups"}
OF_THE_HOST = {"hostNetwork", "hostPID", "hostIPC", "hostUsers"}


def pods(transport: dict[str, Any]) -> Iterator[Manifest]:
    parsed = parse_object(resource({"cloud.runAsUser": None}, transport=transport), "test.yaml")
    for child in children(Parent(parsed, facts(endpoints=EVERY_ENDPOINT, robot_connected=True))):
        if "template" in child.get("spec", {}):
            yield child["spec"]["template"]["spec"]


@pytest.mark.parametrize("name", TRANSPORTS)
def test_every_pod_is_taken_under_the_restricted_constraint(name: str) -> None:
    found = list(pods(TRANSPORTS[name]))
    assert len(found) >= 2
    for pod in found:
        security = pod["securityContext"]
        assert not NUMBERS & security.keys()
        assert security["seccompProfile"] == {"type": "RuntimeDefault"}
        assert security["runAsNonRoot"] is True
        assert not OF_THE_HOST & pod.keys()
        assert {key for volume in pod["volumes"] for key in volume if key != "name"} <= VOLUMES
        for container in (*pod.get("initContainers", ()), *pod["containers"]):
            own = container["securityContext"]
            assert not (NUMBERS | {"privileged", "procMount"}) & own.keys()
            assert own["capabilities"] == {"drop": ["ALL"]}
            assert own["allowPrivilegeEscalation"] is False
            assert not any("hostPort" in port for port in container.get("ports", ()))
