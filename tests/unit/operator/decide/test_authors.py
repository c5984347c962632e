"""Who changed a specification last, out of what the API server keeps."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.v1alpha1.pinned import NO_PIN, PINNED_UNTIL, Hold
from robot_offload.controller.store import Store
from robot_offload.decide.authors import author, kept
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from tests.integration.operator_cluster import walker

SPEC = {"f:spec": {"f:switching": {"f:pin": {}}}}
END = {"f:metadata": {"f:annotations": {f"f:{PINNED_UNTIL}": {}}}}
LABELS = {"f:metadata": {"f:labels": {"f:ward": {}}}}


def entry(manager: str, time: str, fields: Any = SPEC, **more: Any) -> dict[str, Any]:
    return {"manager": manager, "operation": "Update", "time": time, "fieldsV1": fields, **more}


def test_the_last_writer_of_the_specification_counts_and_no_writer_of_a_status_or_a_label() -> None:
    found = {
        "managedFields": [
            entry("argocd", "2026-11-23T10:00:00Z"),
            entry("kubectl-edit", "2026-11-23T11:00:00Z"),
            entry("kubectl-label", "2026-11-23T12:00:00Z", LABELS),
            entry("robot-offload-operator", "2026-11-23T13:00:00Z", {"f:status": {}}, subresource="status"),
        ]
    }
    assert author(found, NO_PIN) == "kubectl-edit at 2026-11-23T11:00:00Z"
    found["managedFields"].append(entry("kubectl-annotate", "2026-11-23T14:00:00Z", END))
    assert author(found, NO_PIN) == "kubectl-annotate at 2026-11-23T14:00:00Z"
    ended = author(found, Hold("Auto", ended="Robot 2026-11-23T15:00:00Z"))
    assert ended == "kubectl-annotate at 2026-11-23T14:00:00Z; the end of the pin: Robot 2026-11-23T15:00:00Z"
    assert author({}, Hold("Auto", ended="Robot 2026-11-23T15:00:00Z")).startswith("somebody; the end of the pin")


def test_of_two_who_wrote_in_the_same_second_both_are_named() -> None:
    time = "2026-11-23T11:00:00Z"
    managed = [
        entry("kubectl-create", time),
        entry("argocd", "2026-11-23T10:59:59Z"),
        entry("kubectl-annotate", time, END),
    ]
    both = f"kubectl-annotate or kubectl-create at {time}"
    for order in (managed, managed[::-1]):
        assert author({"managedFields": order}, NO_PIN) == both
        assert author({"managedFields": kept({"managedFields": order})}, NO_PIN) == both


def test_the_store_keeps_who_it_was_and_drops_the_long_list_of_fields() -> None:
    store, manifest = Store(), walker()
    managed = [entry("kubectl-edit", "2026-11-23T11:00:00Z"), entry("other", "2026-11-23T12:00:00Z", LABELS)]
    manifest["metadata"] |= {"namespace": "ward", "uid": "1", "resourceVersion": "7", "managedFields": managed}
    store.put(ROBOT_OFFLOAD, manifest)
    found = store.get(ROBOT_OFFLOAD, "ward", "walker")
    assert found is not None
    assert found["metadata"]["managedFields"] == [{"manager": "kubectl-edit", "time": "2026-11-23T11:00:00Z"}]
    assert author(found["metadata"], NO_PIN) == author(manifest["metadata"], NO_PIN)


@pytest.mark.parametrize("manager", ["", "two\nlines", "x" * 129, "\x1b[31m"])
def test_a_manager_of_another_form_is_nobody(manager: str) -> None:
    assert author({"managedFields": [entry(manager, "2026-11-23T11:00:00Z")]}, NO_PIN) == ""


@given(
    st.recursive(
        st.none() | st.text() | st.integers(),
        lambda inner: (
            st.lists(inner)
            | st.dictionaries(
                st.sampled_from(
                    ["manager", "time", "fieldsV1", "subresource", "f:spec", "f:metadata", "f:annotations"]
                ),
                inner,
            )
        ),
    )
)
def test_fields_of_any_form_are_no_crash(managed: Any) -> None:
    kept({"managedFields": managed})
