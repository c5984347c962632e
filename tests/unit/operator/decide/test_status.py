"""Conditions, status and events: what a person reads."""

from __future__ import annotations

import datetime
import json
from typing import Any

import pytest

from robot_offload.api.agent_state import ANNOTATION
from robot_offload.api.v1alpha1.status import CONDITION_TYPES, PROGRESS_TYPES
from robot_offload.decide import agent, conditions, status, workloads
from robot_offload.decide.transitions import transitions
from robot_offload.decide.verdicts import Verdict, no, unknown, yes
from robot_offload.findings import Finding
from robot_offload.objects.facts import Endpoint
from tests.unit.operator.decide.worlds import NOW, lease

GOOD = {name: yes("Fine", "fine") for name in CONDITION_TYPES if name != "Ready"}
LATER = NOW + datetime.timedelta(minutes=1)


def built(verdicts: dict[str, Verdict], before: dict[str, Any] | None = None, now: Any = NOW) -> dict[str, Any]:
    return status.build(before or {}, 3, verdicts, now)


def condition(found: dict[str, Any], name: str) -> dict[str, Any]:
    return next(entry for entry in found["conditions"] if entry["type"] == name)


def test_ready_when_everything_is() -> None:
    found = built(GOOD)
    assert [entry["type"] for entry in found["conditions"]] == list(CONDITION_TYPES)
    assert condition(found, "Ready")["status"] == "True"


def test_ready_takes_the_reason_of_the_first_that_is_false_and_only_then_of_an_unknown_one() -> None:
    both = {**GOOD, "ResourcesApplied": unknown("Asking", "?"), "WorkloadsAvailable": no("CrashLoop", "crashes")}
    assert condition(built(both), "Ready")["reason"] == "CrashLoop"
    one = {**GOOD, "CertificatesReady": unknown("Asking", "?")}
    assert (condition(built(one), "Ready")["status"], condition(built(one), "Ready")["reason"]) == ("Unknown", "Asking")


def test_the_cloud_is_ready_while_the_robot_is_switched_off() -> None:
    off = {"Connected": no("NeverConnected", "no robot"), "ConfigCurrent": unknown("NotConnected", "?")}
    assert condition(built({**GOOD, **off}), "Ready")["status"] == "True"


@pytest.mark.parametrize(
    ("name", "verdict", "word"),
    [
        ("WorkloadsAvailable", no("PodsNotReady", "0 of 1"), "Reconciling"),
        ("ResourcesApplied", unknown("Asking", "?"), "Reconciling"),
        ("SpecValid", no("TooShort", "spec.a: too short"), "Stalled"),
        ("ResourcesApplied", no("NameTaken", "somebody has it"), "Stalled"),
        ("ImageBuilt", no("BuildFailed", "error"), "Stalled"),
    ],
)
def test_what_is_not_ready_is_on_its_way_or_waits_for_somebody(name: str, verdict: Verdict, word: str) -> None:
    found = built({**GOOD, name: verdict})
    there = {entry["type"]: entry for entry in found["conditions"] if entry["type"] in PROGRESS_TYPES}
    assert list(there) == [word]
    assert (there[word]["status"], there[word]["reason"]) == ("True", verdict.reason)
    later = built(GOOD, found, LATER)
    assert not [entry for entry in later["conditions"] if entry["type"] in PROGRESS_TYPES]


def test_the_time_of_a_condition_moves_with_its_status_only() -> None:
    first = built(GOOD)
    other_reason = built({**GOOD, "Connected": yes("Other", "other")}, first, LATER)
    assert condition(other_reason, "Connected")["lastTransitionTime"] == "2026-11-21T12:00:00Z"
    assert condition(other_reason, "Connected")["reason"] == "Other"
    fallen = built({**GOOD, "Connected": no("Gone", "gone")}, first, LATER)
    assert condition(fallen, "Connected")["lastTransitionTime"] == "2026-11-21T12:01:00Z"


def test_an_invalid_specification_keeps_what_was_known_and_lists_every_problem() -> None:
    findings = [Finding("spec.a", "First", "is wrong"), Finding("spec.b", "Second", "is wrong too")]
    found = built({"SpecValid": conditions.spec_valid(findings)}, built(GOOD), LATER)
    assert condition(found, "SpecValid")["reason"] == "First"
    assert condition(found, "SpecValid")["message"].splitlines()[:2] == ["spec.a: is wrong", "spec.b: is wrong too"]
    assert condition(found, "Connected")["status"] == "True"
    assert condition(found, "Ready")["reason"] == "First"


def test_the_same_again_is_no_change_to_write() -> None:
    first = built(GOOD)
    assert status.patch(first, built(GOOD, first, LATER)) == {}


def test_a_patch_holds_what_differs_and_takes_away_what_is_gone() -> None:
    before = {"robot": {"connected": False, "lastSeen": "x"}, "placement": "Robot", "nodes": [1]}
    after = {"robot": {"connected": True}, "placement": "Robot", "nodes": [2]}
    assert status.patch(before, after) == {"robot": {"connected": True, "lastSeen": None}, "nodes": [2]}


def test_a_very_long_message_is_cut_to_what_the_schema_takes() -> None:
    found = built({**GOOD, "ResourcesApplied": no("Refused", "x" * 99_999)})
    assert len(condition(found, "ResourcesApplied")["message"]) == 32_768


def test_events_tell_transitions_and_nothing_else() -> None:
    first = built(GOOD)
    assert transitions(first, first) == ()
    fallen = built({**GOOD, "Connected": no("Disconnected", "gone")}, first)
    told = {(event.type, event.reason) for event in transitions(first, fallen)}
    assert told == {("Warning", "Disconnected")}
    assert len(transitions(first, fallen)) == 1
    moved = {**first, "placement": "Cloud", "placementReason": "LinkGood", "placementMessage": "good"}
    assert [(event.reason, event.message) for event in transitions(first, moved)] == [
        ("PlacementCloud", "LinkGood: good")
    ]


def test_the_end_of_a_pin_is_an_event_once() -> None:
    ended = {"pin": {"side": "Auto", "ended": "Robot 2026-11-23T12:10:00Z"}}
    (event,) = transitions({"pin": {"side": "Robot"}}, ended)
    assert (event.type, event.reason) == ("Normal", "PinEnded")
    assert event.message == "The pin to the robot ended at 2026-11-23T12:10:00Z; the policy decides"
    assert transitions(ended, ended) == ()


def test_the_first_status_tells_that_it_was_applied_and_not_what_is_still_missing() -> None:
    first = built({**GOOD, "Connected": no("NeverConnected", "no robot")})
    assert [event.reason for event in transitions({}, first)] == ["ResourcesApplied"]


def state(**values: Any) -> dict[str, Any]:
    return lease(**{ANNOTATION: json.dumps({"version": 1, "connected": True, "site": "cloud", **values})})


def test_the_placement_is_what_the_agent_says_while_the_robot_is_connected() -> None:
    read, problem = agent.state_of(state(reason="LinkGood", message="good"))
    assert agent.placement(read, problem, connected=True) == agent.Placement("Cloud", "LinkGood", "good")
    assert agent.placement(read, problem, connected=False).site == "Unknown"


def test_nonsense_in_the_annotation_is_a_reason_and_no_crash() -> None:
    read, problem = agent.state_of(lease(**{ANNOTATION: "nonsense"}))
    assert read is None
    assert agent.placement(read, problem, connected=True).reason == "NotReported"


def test_the_robots_settings_are_current_pending_refused_or_unknown() -> None:
    def verdict(settings: dict[str, Any], *, connected: bool = True) -> tuple[str, str]:
        read, _ = agent.state_of(state(settings=settings))
        found = agent.config_current(read, 3, connected=connected)
        return found.truth, found.reason

    assert verdict({"robot_generation": 3, "accepted": True}) == ("True", "Current")
    assert verdict({"robot_generation": 2, "accepted": True}) == ("False", "Pending")
    assert verdict({"robot_generation": 2, "accepted": False, "reason": "NeedsBundle"}) == ("False", "NeedsBundle")
    assert verdict({}) == ("Unknown", "NotReported")
    assert verdict({"robot_generation": 3, "accepted": True}, connected=False) == ("Unknown", "NotConnected")


def test_a_bundle_whose_addresses_lead_nowhere_any_more_is_outdated_also_while_the_robot_is_away() -> None:
    def point(purpose: Any, host: str) -> Endpoint:
        return Endpoint(purpose, "UDP", host, 7447 if purpose == "pulse" else 7448)

    read, _ = agent.state_of(state(dials="192.0.2.1:7447 192.0.2.1:7448 192.0.2.2:7447 192.0.2.2:7448"))
    dials = agent.dialled(read, {})
    assert len(dials) == 4
    assert agent.dialled(None, {"dials": ["192.0.2.1:7447"]}) == ("192.0.2.1:7447",), "it has said so before"

    def reason(*endpoints: Endpoint, connected: bool = True) -> str:
        found = agent.config_current(read, 3, connected=connected, dials=dials, endpoints=endpoints)
        return found.reason

    assert reason(point("pulse", "192.0.2.2"), point("data", "192.0.2.1")) == "NotReported"
    assert reason(point("pulse", "192.0.2.1"), point("pulse", "192.0.2.9")) == "NotReported", "one of the nodes is left"
    assert reason(point("pulse", "192.0.2.1"), point("data", "192.0.2.9")) == "BundleOutdated"
    assert reason(point("pulse", "192.0.2.9"), connected=False) == "BundleOutdated"
    assert reason(connected=False) == "NotConnected", "the cloud has no address at the moment"


def test_what_a_robot_dials_is_bounded_and_nothing_but_addresses() -> None:
    read, _ = agent.state_of(state(dials=" ".join(["a:1", "<b>", *(f"h{number}:1" for number in range(99))])))
    assert read is not None
    assert read.dials[:2] == ("a:1", "h0:1")
    assert len(read.dials) == 16


def deployment(replicas: int = 1, **status_: Any) -> dict[str, Any]:
    return {
        "metadata": {"name": "walker-talker", "generation": 2},
        "spec": {"replicas": replicas, "selector": {"matchLabels": {"a": "b"}}},
        "status": status_,
    }


def pod(**status_: Any) -> dict[str, Any]:
    return {"metadata": {"name": "p", "labels": {"a": "b", "c": "d"}}, "status": status_}


READY = {"observedGeneration": 2, "readyReplicas": 1, "updatedReplicas": 1}


def test_a_workload_is_available_when_the_pods_of_its_present_form_are_ready() -> None:
    assert workloads.workload(deployment(**READY)).reason == "Available"
    assert workloads.workload(deployment(**{**READY, "observedGeneration": 1})).reason == "PodsNotReady"
    assert workloads.workload(deployment(replicas=0)).reason == "ScaledDown"


def test_the_reason_for_a_missing_pod_is_found_in_the_pod() -> None:
    waiting = {"state": {"waiting": {"reason": "ImagePullBackOff"}}, "image": "nowhere:1", "name": "talker"}
    found = workloads.workload(deployment(), [pod(containerStatuses=[waiting])])
    assert (found.reason, "nowhere:1" in found.message) == ("ImagePullFailing", True)
    crashing = {
        "state": {"waiting": {"reason": "CrashLoopBackOff"}},
        "lastState": {"terminated": {"exitCode": 3}},
        "name": "talker",
    }
    assert "code 3" in workloads.workload(deployment(), [pod(containerStatuses=[crashing])]).message
    unfit = {"type": "PodScheduled", "status": "False", "message": "no GPU"}
    assert workloads.workload(deployment(), [pod(conditions=[unfit])]).reason == "Unschedulable"


def test_one_discovery_server_of_two_is_enough() -> None:
    good, bad = yes("Available"), no("PodsNotReady", "not yet")
    assert conditions.discovery_ready(2, [good, good]).reason == "Available"
    assert conditions.discovery_ready(2, [good, bad]).reason == "Degraded"
    assert conditions.discovery_ready(2, [good, bad]).holds
    assert not conditions.discovery_ready(2, [bad, bad]).holds
    assert conditions.discovery_ready(0, []).reason == "NotNeeded"


def test_what_waits_for_a_person_is_named_before_what_time_may_mend() -> None:
    both = {
        **GOOD,
        "DiscoveryReady": no("PodsNotReady", "0 of 1"),
        "WorkloadsAvailable": no("PodsRefused", "w-agent: forbidden: exceeded quota"),
    }
    ready = condition(built(both), "Ready")
    assert (ready["reason"], ready["message"]) == (
        "PodsRefused",
        "WorkloadsAvailable: w-agent: forbidden: exceeded quota",
    )
    assert condition(built(both), "Stalled")["reason"] == "PodsRefused"


def test_of_several_workloads_the_gravest_names_the_reason() -> None:
    bad = [no("PodsNotReady", "a"), no("PodsRefused", "b")]
    assert workloads.together(bad, yes("Available", "")) == no("PodsRefused", "a; b")
    discovery = conditions.discovery_ready(2, bad)
    assert (discovery.reason, discovery.message) == ("PodsRefused", "No discovery server is ready: b")


def test_a_workload_without_pods_and_without_words_is_asked_about() -> None:
    servers = {"apiVersion": "apps/v1", "kind": "StatefulSet", "metadata": {"name": "d"}, "spec": {"replicas": 1}}
    assert workloads.podless(servers)
    assert not workloads.podless({**servers, "status": {"replicas": 1}})
    assert not workloads.podless({**servers, "spec": {"replicas": 0}})
    assert not workloads.podless({**servers, "kind": "Deployment"})
    job = {"apiVersion": "batch/v1", "kind": "Job", "metadata": {"name": "b"}}
    assert workloads.podless(job)
    assert not workloads.podless({**job, "status": {"active": 1}})
    verdict = workloads.workload(servers, (), 'pods "d-0" is forbidden: failed quota')
    assert (verdict.reason, verdict.message.endswith("is forbidden: failed quota")) == ("PodsRefused", True)
