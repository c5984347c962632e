"""Why it is not Ready, and the next step."""

from __future__ import annotations

import dataclasses
from typing import Any

from robot_offload.api.agent_state import parse_state
from robot_offload.cli.status.explain import lines
from robot_offload.insight.explanation import Explanation, explain
from robot_offload.insight.handover import handover
from robot_offload.insight.observed import Observed, observe
from tests.unit.operator.cli.resources import NOW, manifest, observed
from tests.unit.operator.reporter.states import REPORT, text


def explained(offload: Observed, *events: dict[str, Any], deleting: bool = False) -> Explanation:
    return explain(offload, deleting=deleting, events=events, now=NOW)


def test_what_is_ready_needs_no_step() -> None:
    found = explained(observed())
    assert (found.ready, found.headline, found.problems) == (True, "ward/wheelchair-7 is Ready", ())


def test_what_is_in_flight_is_explained_as_the_agents_say_it_now() -> None:
    notes = explain(observed(), deleting=False, events=(), now=NOW, state=parse_state(text(robot=REPORT))).notes
    assert "Goals of /go now: 1 executing, 2 waiting, 4 restarts." in notes
    assert "Calls of /plan that wait for their answer: 3." in notes
    assert "Goals of the duplicated nodes at servers outside, not ended yet: 1." in notes
    assert any(line.endswith("controller_1 85 ms in the cloud, amcl 80 ms on the robot.") for line in notes)
    assert not [line for line in explained(observed()).notes if "now:" in line]


def test_the_cause_comes_first_and_has_a_next_step_with_the_real_names() -> None:
    found = explained(
        observed(
            WorkloadsAvailable=("False", "ImagePullFailing", "w-controller: the image x cannot be pulled"),
            ConfigCurrent=("Unknown", "NotConnected", "nobody can tell"),
            Ready=("False", "ImagePullFailing", "WorkloadsAvailable: ..."),
        )
    )
    assert found.headline == "ward/wheelchair-7 is not Ready: ImagePullFailing"
    assert [problem.condition for problem in found.problems] == ["WorkloadsAvailable", "ConfigCurrent"]
    cause = found.problems[0]
    assert (cause.since, cause.message) == ("3m", "w-controller: the image x cannot be pulled")
    assert "spec.nodes[].image" in cause.step
    assert "-n ward" in cause.step
    assert "{" not in cause.step


def test_a_robot_that_is_switched_off_is_told_and_is_no_reason_for_the_cloud_not_to_be_ready() -> None:
    found = explained(observed(Connected=("False", "NeverConnected", "no robot")))
    assert (found.ready, found.headline) == (True, "ward/wheelchair-7 is Ready; the robot: NeverConnected")
    assert "bundle" in found.problems[0].step


def test_every_problem_of_a_specification_is_told() -> None:
    found = explained(observed(SpecValid=("False", "TooShort", "spec.a: too short\nspec.b: too long")))
    text = lines(found)
    assert "  spec.a: too short" in text
    assert "  spec.b: too long" in text
    assert any("validate" in line for line in text)


def test_an_object_without_status_points_at_the_operator() -> None:
    values = manifest()
    del values["status"]
    found = explained(observe(values))
    assert [problem.reason for problem in found.problems] == ["NoStatus"]
    assert found.problems[0].since == "2h"


def test_a_change_that_was_not_dealt_with_yet_is_not_ready() -> None:
    found = explained(dataclasses.replace(observed(), generation=4))
    assert (found.ready, [problem.reason for problem in found.problems]) == (False, ["InProgress"])


def test_an_object_that_is_being_deleted_is_nothing_else() -> None:
    broken = observed(WorkloadsAvailable=("False", "CrashLoop", "x"))
    assert [problem.reason for problem in explained(broken, deleting=True).problems] == ["BeingDeleted"]


def test_an_operator_that_says_no_more_than_not_ready_is_believed() -> None:
    found = explained(observed(Ready=("False", "SomethingNew", "because")))
    assert [(problem.reason, problem.message) for problem in found.problems] == [("SomethingNew", "because")]
    assert "log" in found.problems[0].step


def test_what_holds_the_application_is_noted() -> None:
    values = manifest(SpecValid=("True", "ValidWithWarnings", "spec.x: odd"))
    values["spec"]["switching"]["pin"] = "Robot"
    notes = explained(observe(values)).notes
    assert notes[0] == "It is pinned to Robot; kubectl offload pin wheelchair-7 auto lets it decide again."
    assert "Warning: spec.x: odd" in notes


def test_the_last_warnings_about_it_and_its_children_are_shown_once() -> None:
    def event(name: str, message: str, minute: int, kind: str = "Warning") -> dict[str, Any]:
        return {
            "type": kind,
            "reason": "Failed",
            "message": message,
            "involvedObject": {"kind": "Pod", "name": name},
            "lastTimestamp": f"2026-11-21T10:0{minute}:00Z",
        }

    found = explained(
        observed(),
        event("wheelchair-7-agent-1", "old", 1),
        event("wheelchair-7-agent-1", "again", 2),
        event("wheelchair-7-agent-1", "again", 5),
        event("wheelchair-7-agent-1", "fine", 6, "Normal"),
        event("wheelchair-70-agent-1", "another robot", 6),
        event("other", "not ours", 6),
    )
    assert found.events == (
        "9m ago, Pod wheelchair-7-agent-1: Failed: old",
        "5m ago, Pod wheelchair-7-agent-1: Failed: again",
    )


def test_only_the_last_five_warnings_are_shown() -> None:
    many = [
        {"type": "Warning", "reason": "R", "message": str(number), "involvedObject": {"name": "wheelchair-7"}}
        for number in range(9)
    ]
    assert len(explained(observed(), *many).events) == 5


def test_what_becomes_of_nodes_and_outputs_is_told() -> None:
    controller = {
        "name": "controller",
        "placement": "Duplicated",
        "standby": {"robot": "Hot", "cloud": "Warm"},
        "outputs": [
            {"topic": "/cmd_vel", "rate": 20, "while": {"actions": ["/follow_path", "/spin"]}},
            {"topic": "/marks", "while": {"topic": "/image", "within": "200ms"}},
            {"topic": "/tf", "frames": [{"parent": "map", "child": "odom"}]},
            {"topic": "/diagnostics", "shared": True},
        ],
    }
    filter_ = {"name": "filter", "placement": "Duplicated", "lifecycle": False, "outputs": [{"topic": "/filtered"}]}
    detector = {"name": "detector", "placement": "Cloud", "outputs": [{"topic": "/detections"}]}
    assert list(handover({"nodes": [controller, filter_, detector]})) == [
        "controller stays Active on the robot while the other side acts (Hot).",
        "/cmd_vel is expected to speak only while a goal of /follow_path is executed or a goal of /spin is executed.",
        "/marks is expected to speak only while /image arrives (each counts for 200ms).",
        "/tf is shared: both sides hear all that others publish there, map -> odom of the acting side.",
        "/diagnostics is shared: both sides hear all that others publish there.",
        "filter has no lifecycle: it runs on both sides all the time, one of them is heard.",
        (
            "detector runs in the cloud only: /detections reach the robot whichever side acts, or are silent; "
            "/offload/available says why."
        ),
    ]


def test_what_becomes_of_goals_calls_and_state_is_told() -> None:
    controller = {
        "name": "controller",
        "placement": "Duplicated",
        "actions": [{"name": "/drive_to", "type": "a/action/B", "onSwitch": "Continue"}],
        "services": [{"name": "/how_far", "type": "a/srv/B"}],
        "state": [{"snapshot": True}, {"topic": "/pose", "restore": "/initialpose"}, {"parameters": {}}],
    }
    elsewhere = {"name": "base", "placement": "Robot", "services": [{"name": "/own"}]}
    assert list(handover({"nodes": [elsewhere, controller]})) == [
        "At a change of sides, goals of /drive_to go on with the replica of the other side (Continue).",
        "Calls of /how_far are executed at most once, by the acting side (Holder).",
        "controller hands over its snapshots.",
        "controller hands over /pose, which its replica gets as /initialpose.",
        "controller hands over its parameters.",
    ]
    found = explained(dataclasses.replace(observed(), spec={"nodes": [controller]}))
    assert any("goals of /drive_to go on" in note for note in found.notes)
