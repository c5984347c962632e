"""Many live in one cluster: what is hostile or idle costs its neighbours nothing."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robot_offload.kube.kinds import CONFIG_MAP, ROBOT_OFFLOAD, SECRET
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import Manifest, Place, eventually, walker
from tests.integration.operator_process import Operator
from tests.integration.operator_proxy import Proxy

pytestmark = pytest.mark.api


def reading(name: str, config_map: str, nodes: int) -> Manifest:
    """A RobotOffload whose nodes read one parameter file."""
    run = {
        "package": "p",
        "executable": "e",
        "parametersFrom": {"configMapKeyRef": {"name": config_map, "key": "all.yaml"}},
    }
    return walker(
        name,
        nodes=[
            {"name": f"node_{number}", "placement": "Duplicated", "image": "registry.example/n:1", "run": run}
            for number in range(nodes)
        ],
    )


def settle(place: Place, *names: str) -> None:
    """Makes RobotOffloads, one after the other is applied."""
    for name in names:
        place.create(ROBOT_OFFLOAD, walker(name))
        place.applied(name)


def worked_s(operator: Operator) -> float:
    """The processor time that the operator has used: unlike the time of day it has no part in a busy machine."""
    ticks = Path(f"/proc/{operator.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(int(each) for each in ticks) / os.sysconf("SC_CLK_TCK")


MOST_TIMES = 40
"""What three plain robots and three hostile ones may cost, in the work of the plain ones alone: 8 times."""
HOSTILE = {
    "nested": "[" * 250_000,
    "many keys": "".join(f"n{number}: {{ros__parameters: {{x: {number}}}}}\n" for number in range(7_000)),
    "too large": "#" * 900_000,
}


def test_a_hostile_neighbour_costs_others_neither_their_time_nor_the_operator_its_life(
    place: Place, operator: Operator, new_namespace: Callable[..., str], control_plane: ControlPlane
) -> None:
    idle_s = worked_s(operator)
    settle(place, *(f"before-{number}" for number in range(3)))
    alone_s = worked_s(operator) - idle_s
    hostile = Place(control_plane, new_namespace())
    for number, text in enumerate(HOSTILE.values()):
        hostile.create(
            CONFIG_MAP,
            {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": f"f{number}"}, "data": {"all.yaml": text}},
        )
        hostile.create(ROBOT_OFFLOAD, reading(f"hostile-{number}", f"f{number}", 64))
    settle(place, *(f"beside-{number}" for number in range(3)))
    assert operator.ask("health", "/healthz")[0] == 200
    condition = hostile.wait_condition("ResourcesApplied", "False", "CannotRender", name="hostile-2")
    assert "900000 bytes, more than 262144" in condition["message"]
    hostile.wait_condition("ResourcesApplied", "True", name="hostile-1")
    beside_s = worked_s(operator) - idle_s - alone_s
    assert beside_s <= MOST_TIMES * alone_s, f"{alone_s:.2f} s of work alone, {beside_s:.2f} s beside hostile ones"


def test_a_pass_over_what_has_not_changed_asks_the_api_server_nothing(
    control_plane: ControlPlane,
    namespace: str,
    proxy: Proxy,
    tmp_path_factory: pytest.TempPathFactory,
    operator: Operator,
) -> None:
    place = Place(control_plane, namespace)
    config = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "f"}, "data": {"all.yaml": "a: {}"}}
    place.create(CONFIG_MAP, config)
    place.create(ROBOT_OFFLOAD, reading("walker", "f", 2))
    place.applied()
    proxy.quiet(namespace)
    place.patch(ROBOT_OFFLOAD, "walker", {"metadata": {"annotations": {"look": "again"}}})
    count = len(proxy.asked)
    passes = passes_of(operator)
    eventually(lambda: passes_of(operator) > passes, "a pass")
    proxy.quiet(namespace)
    asked = [
        f"{one.method} {one.path}" for one in proxy.asked[count:] if f"/{namespace}/" in one.path and not one.watch
    ]
    assert asked == []
    place.patch(CONFIG_MAP, "f", {"data": {"all.yaml": "node_0: {ros__parameters: {x: 1}}"}})
    eventually(
        lambda: "remote_node_0" in str((place.get(CONFIG_MAP, "walker-renamed-parameters") or {}).get("data")),
        "the new parameters in the replica's copy",
    )


def test_a_restarted_operator_reads_all_certificates_in_lists_and_writes_nothing(
    place: Place, operator: Operator, proxy: Proxy
) -> None:
    for number in range(3):
        place.create(ROBOT_OFFLOAD, walker(f"robot-{number}"))
    for number in range(3):
        place.applied(f"robot-{number}")
    proxy.quiet(place.namespace)
    ours = [place.namespace, *(place.there(ROBOT_OFFLOAD, f"robot-{number}")["metadata"]["uid"] for number in range(3))]
    count = len(proxy.asked)
    operator.restart()
    eventually(lambda: passes_of(operator) >= 3, "passes of the new operator")
    proxy.quiet(place.namespace)
    asked = [one for one in proxy.asked[count:] if not one.watch and any(word in one.path for word in ours)]
    assert [f"{one.method} {one.path}" for one in asked] == []
    place.delete(SECRET, "robot-1-robot")
    eventually(lambda: place.get(SECRET, "robot-1-robot"), "the certificate to be made again")


def passes_of(operator: Operator) -> float:
    lines = operator.ask("metrics", "/metrics")[1].splitlines()
    return sum(float(line.rpartition(" ")[2]) for line in lines if line.startswith("robot_offload_reconciles_total"))


def test_what_was_deleted_while_the_watches_were_down_is_made_again(place: Place, proxy: Proxy) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    proxy.quiet(place.namespace)
    gone: dict[str, Any] = place.there(CONFIG_MAP, "walker-settings")
    proxy.cut_watches()
    place.delete(CONFIG_MAP, "walker-settings")
    eventually(
        lambda: (place.get(CONFIG_MAP, "walker-settings") or gone)["metadata"]["uid"] != gone["metadata"]["uid"],
        "the ConfigMap to be made again",
    )
