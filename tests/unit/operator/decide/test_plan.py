"""What is written: exactly what differs, never what belongs to somebody else."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robot_offload.decide.drift import in_place, settle, stamped
from robot_offload.decide.ownership import APPLIED, key_of
from robot_offload.decide.plan import History, Plan, plan
from robot_offload.kube.kinds import CONFIG_MAP

UID = "u-1"


def child(name: str = "settings", uid: str = UID, **fields: Any) -> dict[str, Any]:
    return {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": {
            "name": name,
            "namespace": "fleet",
            "labels": {"a": "b"},
            "ownerReferences": [{"kind": "RobotOffload", "name": "walker", "uid": uid, "controller": True}],
        },
        "data": {"key": "value"},
        **fields,
    }


def live(manifest: dict[str, Any], **metadata: Any) -> dict[str, Any]:
    """The manifest as the API server has it after we applied it."""
    there = deepcopy(stamped(manifest, UID))
    there["metadata"].update({"uid": "c-1", "resourceVersion": "5", "managedFields": [], **metadata})
    there["status"] = {"anything": 1}
    return there


def planned(wanted: list[dict[str, Any]], there: list[dict[str, Any]]) -> Plan:
    live = {key_of(manifest): manifest for manifest in there}
    return plan(wanted, live, UID, prunable=live)


def test_a_missing_child_is_applied_without_force() -> None:
    (step,) = planned([child()], []).applies
    assert not step.force
    assert step.manifest["metadata"]["annotations"][APPLIED].startswith(f"{UID}/")
    assert "uid" not in step.manifest["metadata"]


def test_a_child_that_is_as_wanted_is_left_alone_with_what_others_added() -> None:
    there = live(child())
    there["metadata"]["labels"]["theirs"] = "yes"
    there["data"]["more"] = "of theirs"
    assert not planned([child()], [there]).touched


def test_a_changed_field_is_taken_back_on_exactly_that_object() -> None:
    there = live(child())
    there["data"]["key"] = "edited"
    (step,) = planned([child()], [there]).applies
    assert step.force
    assert step.body["metadata"]["uid"] == "c-1"
    assert "uid" not in step.manifest["metadata"]


def test_an_entry_added_to_an_atomic_field_is_taken_back() -> None:
    service = {**child(), "kind": "Service", "spec": {"selector": {"app": "ours"}}}
    binding = {
        **child(),
        "apiVersion": "rbac.authorization.k8s.io/v1",
        "kind": "RoleBinding",
        "subjects": [{"kind": "ServiceAccount", "name": "ours", "namespace": "fleet"}],
    }
    there = [live(service), live(binding)]
    there[0]["spec"]["selector"]["app.kubernetes.io/name"] = "evil"
    there[1]["subjects"].append({"kind": "User", "name": "eve", "apiGroup": "rbac.authorization.k8s.io"})
    steps = planned([service, binding], there).applies
    assert [(step.manifest["kind"], step.force) for step in steps] == [("Service", True), ("RoleBinding", True)]


def test_what_others_add_with_power_over_a_pod_is_named() -> None:
    pod = {"containers": [{"name": "agent", "image": "agent:1", "env": [{"name": "HOME", "value": "/tmp"}]}]}
    workload = {**child(), "apiVersion": "apps/v1", "kind": "Deployment", "spec": {"template": {"spec": pod}}}
    there = live(workload)
    seen = there["spec"]["template"]["spec"]
    seen |= {"dnsPolicy": "ClusterFirst", "restartPolicy": "Always", "securityContext": {}, "schedulerName": "x"}
    seen["containers"][0] |= {"imagePullPolicy": "Always", "terminationMessagePath": "/x", "resources": {}}
    assert planned([workload], [there]) == Plan()
    seen["hostNetwork"] = True
    seen["containers"].append({"name": "evil", "image": "evil:1"})
    seen["containers"][0]["env"].append({"name": "LD_PRELOAD", "value": "/evil.so"})
    seen["containers"][0]["command"] = ["sh"]
    (added,) = planned([workload], [there]).additions
    assert added.startswith("Deployment settings: hostNetwork, container evil, command of container agent, ")
    assert added.endswith("variable LD_PRELOAD of container agent")


def test_foreign_keys_of_files_are_named() -> None:
    there = live(child())
    there["data"]["more"] = "of theirs"
    assert planned([child()], [there]).additions == ("ConfigMap settings: key more",)


def test_a_field_that_is_no_longer_wanted_needs_a_write_too() -> None:
    assert planned([child(data={})], [live(child())]).applies


def test_a_child_that_is_no_longer_wanted_is_deleted_only_if_it_is_ours() -> None:
    strange = child("strange", uid="u-2")
    result = planned([], [live(child()), strange])
    assert [there["metadata"]["name"] for there in result.deletes] == ["settings"]


def test_a_child_whose_owner_somebody_removed_is_known_by_our_mark_and_put_right() -> None:
    there = live(child())
    del there["metadata"]["ownerReferences"]
    (step,) = planned([child()], [there]).applies
    assert step.manifest["metadata"]["ownerReferences"]


def test_a_strangers_object_of_the_same_name_is_an_obstacle_that_stays() -> None:
    stranger = child()
    stranger["metadata"]["ownerReferences"] = []
    result = planned([child()], [stranger])
    assert not result.touched
    (obstacle,) = result.obstacles
    assert (obstacle.reason, obstacle.passing) == ("NameTaken", False)
    assert "has no owner" in obstacle.message


def test_a_child_of_an_earlier_resource_of_this_name_is_waited_for() -> None:
    (obstacle,) = planned([child()], [child(uid="u-0")]).obstacles
    assert (obstacle.reason, obstacle.passing) == ("WaitingForDeletion", True)


def test_a_child_on_its_way_out_is_waited_for_and_not_deleted_twice() -> None:
    leaving = live(child(), deletionTimestamp="2026-11-21T12:00:00Z")
    assert planned([child()], [leaving]).obstacles[0].reason == "WaitingForDeletion"
    assert not planned([], [leaving]).touched


def test_what_is_in_the_way_is_read_once_more_like_what_would_be_written() -> None:
    leaving = live(child(), deletionTimestamp="2026-11-21T12:00:00Z")
    assert planned([child()], [leaving]).doubtful == (key_of(leaving),)
    assert planned([child()], [child(uid="u-0")]).doubtful == (key_of(child()),)
    assert planned([child()], []).doubtful == (key_of(child()),)


def test_only_what_may_be_pruned_is_pruned() -> None:
    there = live(child())
    assert not plan([], {key_of(there): there}, UID).touched
    assert plan([], {key_of(there): there}, UID, prunable=[(CONFIG_MAP, "settings")]).deletes == (there,)


def test_a_field_that_somebody_sets_again_and_again_is_taken_back_three_times_and_then_ever_less_often() -> None:
    history, edited = History(), live(child())
    edited["data"]["key"] = "edited"
    edited["metadata"]["managedFields"] = [{"manager": "robot-offload", "time": "9"}, {"manager": "rival", "time": "8"}]
    there, taken, obstacles = {key_of(edited): edited}, [], []
    for second in range(200):
        found = plan([child()], there, UID, history=history, now_s=second)
        for step in found.applies:
            history.remember(step, live(child()), second)
            taken.append(second)
        obstacles += found.obstacles
    assert taken == [0, 1, 2, 3, 33, 93]  # the first one is the change that we wanted ourselves
    assert {obstacle.reason for obstacle in obstacles} == {"Contested"}
    assert "field manager 'rival'" in obstacles[0].message
    assert obstacles[0].recheck_s == 29.0
    assert plan([child()], there, UID, history=history, now_s=1000).applies, "the pause ends"


def test_a_child_that_is_healed_now_and_then_is_no_contest() -> None:
    history, edited = History(), live(child())
    edited["data"]["key"] = "edited"
    for second in range(0, 1000, 100):
        (step,) = plan([child()], {key_of(edited): edited}, UID, history=history, now_s=second).applies
        history.remember(step, live(child()), second)


def test_values_that_the_server_writes_in_its_own_way_settle_after_one_write() -> None:
    wanted = stamped(child(data={"cpu": "0.5"}), UID)
    answer = live(child(data={"cpu": "0.5"}))
    answer["data"] = {"cpu": "500m"}
    assert not in_place(wanted, answer, None)
    settled = settle(wanted, answer)
    assert in_place(wanted, answer, settled)
    answer["data"] = {"cpu": "600m"}
    assert not in_place(wanted, answer, settled)


def test_entries_of_lists_are_found_by_their_names_whatever_stands_around_them() -> None:
    wanted = child(items=[{"name": "agent", "image": "a:1"}, {"name": "reporter", "image": "r:1"}])
    there, wanted = live(wanted), stamped(wanted, UID)
    there["items"] = [{"name": "injected"}, {"name": "reporter", "image": "r:1", "tty": False}]
    assert not in_place(wanted, there, None)
    there["items"].append({"name": "agent", "image": "a:1"})
    assert in_place(wanted, there, None)


def test_ports_of_one_number_are_told_apart_by_their_protocol() -> None:
    ports = [{"port": 7447, "protocol": "UDP", "name": "a"}, {"port": 7447, "name": "b"}]
    there = live(child(items=ports))
    there["items"] = [{"port": 7447, "protocol": "TCP", "name": "b"}, {**ports[0]}]
    assert in_place(stamped(child(items=ports), UID), there, None)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)


@given(VALUES)
def test_whatever_was_applied_and_comes_back_unchanged_needs_no_write(value: Any) -> None:
    wanted = child(data=value)
    there = live(wanted)
    assert in_place(stamped(wanted, UID), there, settle(stamped(wanted, UID), there))


@given(VALUES, VALUES)
def test_another_wanted_manifest_always_needs_a_write(old: Any, new: Any) -> None:
    if stamped(child(data=old), UID) != stamped(child(data=new), UID):
        assert planned([child(data=new)], [live(child(data=old))]).applies
