"""An upgrade replaces pods a few robots at a time, and discovery servers one after the other."""

from __future__ import annotations

from typing import Any

from robot_offload.decide.drift import stamped
from robot_offload.decide.ownership import Key, key_of
from robot_offload.decide.plan import Plan, plan
from robot_offload.decide.rollouts import (
    FIRST_LOOK_S,
    GIVE_UP_S,
    LOOK_AGAIN_S,
    Budget,
    held_back,
    in_turn,
    under_way,
)

UID = "u-1"


def workload(kind: str, name: str, image: str = "server:1") -> dict[str, Any]:
    return {
        "apiVersion": "apps/v1",
        "kind": kind,
        "metadata": {
            "name": name,
            "namespace": "fleet",
            "ownerReferences": [{"kind": "RobotOffload", "name": "walker", "uid": UID, "controller": True}],
        },
        "spec": {"replicas": 1, "template": {"spec": {"containers": [{"name": "c", "image": image}]}}},
    }


def live(manifest: dict[str, Any], ready: bool = True) -> dict[str, Any]:
    there = stamped(manifest, UID)
    there["metadata"] = {**there["metadata"], "uid": f"uid-{manifest['metadata']['name']}", "generation": 1}
    return {**there, "status": {"observedGeneration": 1, "readyReplicas": int(ready), "updatedReplicas": int(ready)}}


def servers(image: str) -> list[dict[str, Any]]:
    return [workload("StatefulSet", f"walker-discovery-{server}", image) for server in range(2)]


def step(there: list[dict[str, Any]], wanted: list[dict[str, Any]]) -> tuple[Plan, list[str]]:
    known: dict[Key, dict[str, Any]] = {key_of(child): child for child in there}
    steps = in_turn(plan(wanted, known, UID), known)
    return steps, [apply.manifest["metadata"]["name"] for apply in steps.applies]


def test_the_second_discovery_server_waits_until_the_first_one_is_back() -> None:
    old, new = [live(one) for one in servers("server:1")], servers("server:2")
    steps, applied = step(old, new)
    assert applied == ["walker-discovery-0"]
    assert [(one.reason, one.recheck_s) for one in steps.obstacles] == [("WaitingForTurn", LOOK_AGAIN_S)]
    assert step([live(new[0], ready=False), old[1]], new)[1] == []
    assert step([live(new[0]), old[1]], new)[1] == ["walker-discovery-1"]
    assert step([live(one) for one in new], new)[1] == []


def test_a_server_that_has_just_returned_is_waited_for() -> None:
    old, new = [live(one) for one in servers("server:1")], servers("server:2")
    returned = live(new[0])
    returned["status"]["availableReplicas"] = 0
    assert step([returned, old[1]], new)[1] == []
    returned["status"]["availableReplicas"] = 1
    assert step([returned, old[1]], new)[1] == ["walker-discovery-1"]


def test_a_server_that_does_not_start_is_mended_and_its_fellow_stays() -> None:
    there = [
        live(workload("StatefulSet", "walker-discovery-0", "missing:1"), ready=False),
        live(servers("server:1")[1]),
    ]
    assert step(there, servers("server:2"))[1] == ["walker-discovery-0"]


def test_servers_are_made_all_at_once() -> None:
    assert len(step([], servers("server:1"))[1]) == 2


def test_what_replaces_no_pod_is_not_held_back() -> None:
    there = [live(workload("Deployment", "walker-talker")), live(workload("Deployment", "walker-agent"))]
    wanted = [workload("Deployment", "walker-talker", "talker:2"), workload("Deployment", "walker-agent")]
    wanted[1]["spec"]["replicas"] = 0
    known = {key_of(child): child for child in there}
    steps = held_back(plan(wanted, known, UID), known)
    assert [apply.manifest["metadata"]["name"] for apply in steps.applies] == ["walker-agent"]
    assert [one.reason for one in steps.obstacles] == ["WaitingForTurn"]


def budget_of(at_once: int) -> Budget[str]:
    budget: Budget[str] = Budget(at_once)
    budget.resume((), 0.0)
    return budget


def test_no_more_robots_than_the_budget_are_replaced_at_once() -> None:
    budget = budget_of(2)
    assert [budget.may_roll(name, 0.0, cloud_acts=False) for name in "abc"] == [True, True, False]
    assert budget.may_roll("a", 1.0, cloud_acts=False), "a turn that was taken is kept"
    budget.done("a")
    assert budget.may_roll("c", 2.0, cloud_acts=False)
    assert not budget.may_roll("d", 2.0, cloud_acts=False)
    assert budget.may_roll("d", GIVE_UP_S + 2.0, cloud_acts=False), "who does not become ready makes room"


def test_robots_whose_cloud_acts_wait_for_those_that_lose_nothing() -> None:
    budget = budget_of(1)
    assert budget.may_roll("idle-1", 0.0, cloud_acts=False)
    assert not budget.may_roll("idle-2", 0.0, cloud_acts=False)
    budget.done("idle-1")
    assert not budget.may_roll("acting", 1.0, cloud_acts=True)
    assert budget.may_roll("idle-2", 2.0, cloud_acts=False)
    budget.done("idle-2")
    assert budget.may_roll("acting", 3.0, cloud_acts=True)


def test_a_robot_whose_cloud_acts_waits_also_for_those_that_a_new_operator_has_not_looked_at_yet() -> None:
    budget: Budget[str] = Budget(2)
    budget.resume((), 0.0, ["idle", "current"])
    assert not budget.may_roll("acting", 0.0, cloud_acts=True)
    assert budget.may_roll("idle", 1.0, cloud_acts=False)
    assert not budget.may_roll("acting", 2.0, cloud_acts=True)
    budget.done("current")  # nothing of it is replaced
    assert budget.may_roll("acting", 3.0, cloud_acts=True)
    silent: Budget[str] = Budget(2)
    silent.resume((), 0.0, ["refused"])
    assert silent.may_roll("acting", FIRST_LOOK_S + 3 * LOOK_AGAIN_S, cloud_acts=True), "not for ever"


def test_turns_that_an_earlier_operator_gave_count() -> None:
    budget: Budget[str] = Budget(2)
    assert not budget.may_roll("a", 0.0, cloud_acts=False), "nothing is known of the earlier operator yet"
    budget.resume(["b", "c"], 1.0)
    assert [budget.may_roll(name, 2.0, cloud_acts=False) for name in "abc"] == [False, True, True]
    budget.done("b")
    assert budget.may_roll("a", 3.0, cloud_acts=False)


def deployment(reason: str, revision: str, **status: Any) -> dict[str, Any]:
    manifest = workload("Deployment", "walker-agent")
    manifest["metadata"] |= {"generation": 2, "annotations": {"deployment.kubernetes.io/revision": revision}}
    progress = {"type": "Progressing", "status": "True", "reason": reason}
    return {**manifest, "status": {"observedGeneration": 2, "updatedReplicas": 1, "conditions": [progress], **status}}


def test_a_workload_says_itself_whether_its_pods_are_being_replaced() -> None:
    assert under_way(deployment("ReplicaSetUpdated", "2"))
    assert under_way(deployment("NewReplicaSetAvailable", "1", observedGeneration=1)), "not seen by its controller yet"
    assert not under_way(deployment("ReplicaSetUpdated", "1")), "its first pods replace none"
    assert not under_way(deployment("NewReplicaSetAvailable", "2")), "a pod died, or returns after a scaling"
    assert not under_way(deployment("ProgressDeadlineExceeded", "2")), "given up"
    assert not under_way(deployment("ReplicaSetUpdated", "2", readyReplicas=1))


def test_a_discovery_server_says_itself_whether_its_pod_is_being_replaced() -> None:
    def server(current: str, ready: int) -> dict[str, Any]:
        there = live(workload("StatefulSet", "walker-discovery-0"), ready=bool(ready))
        there["status"] |= {"currentRevision": current, "updateRevision": "b"}
        return there

    assert under_way(server("a", 0))
    assert not under_way(server("b", 0)), "it is only not ready"
    assert not under_way(server("b", 1))
