"""Switches by people and by other decision makers: four services, the maintenance override, pins."""

from collections.abc import Callable, Iterator

import pytest

from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.record import audit
from tests.ros.agent.ears import Ear
from tests.ros.agent.harness import Plan, World
from tests.ros.agent.passage import UNDISTURBED_S, holes, longest_gap_s
from tests.ros.agent.shared import Shared, judged

FOUR = {
    "/guardian_activate_local_nodes": "robot",
    "/guardian_activate_cloud_nodes": "cloud",
    "/guardian_deactivate_cloud_nodes": "robot",
    "/guardian_deactivate_local_nodes": "cloud",
}


@pytest.fixture(scope="module")
def own() -> Iterator[Shared]:
    """A world of this module's own: a switch by hand outweighs the policy for half a minute."""
    shared = Shared(Plan(domains=(76, 77)))
    yield shared
    shared.close()


@pytest.fixture
def world(own: Shared) -> Iterator[World]:
    yield from judged(own)


def asked(world: World, ear: Ear, service: str) -> str:
    """Calls a service until it is accepted (a readiness may be missing for a moment); returns the message."""
    answers = []

    def accepted() -> bool:
        answers.append(ear.trigger(service))
        return bool(answers[-1].success)

    world.until(accepted, f"{service} is accepted")
    return str(answers[-1].message)


@pytest.mark.core
def test_each_of_the_four_services_switches_without_a_hole_and_twice_is_the_same_as_once(world: World) -> None:
    since, at_s = len(world.arrivals), now_s()
    for service, side in FOUR.items():
        asked(world, world.ear, service)
        world.goes_to(side)
        assert "already" in asked(world, world.ear, service)
    assert holes(world.arrivals[since:]) == 0
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    assert world.site == "cloud"

    def by_hand() -> list[str]:
        entries = audit.exported(world.audit_trail())
        return [entry["what"]["to"] for entry in entries if entry["who"] == "service on the robot"]

    world.until(lambda: set(FOUR.values()) <= set(by_hand()), "the switches by hand are in the audit trail")
    assert audit.verify(world.audit_trail()).problems == ()


def test_the_cloud_serves_the_cloud_services_and_the_robot_answers_them(world: World) -> None:
    asked(world, world.cloud_ear(), "/guardian_deactivate_cloud_nodes")
    world.goes_to("robot")
    asked(world, world.cloud_ear(), "/guardian_activate_cloud_nodes")
    world.goes_to("cloud")


def test_a_switch_against_the_override_is_refused_with_a_reason(world: World) -> None:
    world.place("robot", stay=True)
    for ear in (world.ear, world.cloud_ear()):
        answer = ear.trigger("/guardian_activate_cloud_nodes")
        assert not answer.success
        assert "Pinned" in answer.message
    assert world.ear.trigger("/guardian_activate_local_nodes").success


def test_a_switch_in_the_cloud_is_refused_when_the_robot_does_not_answer(world: World) -> None:
    world.cut("both")
    answer = world.cloud_ear().trigger("/guardian_activate_cloud_nodes")
    assert not answer.success
    assert "RobotUnheard" in answer.message


def test_a_bad_override_is_refused_with_the_words_that_are_allowed(world: World) -> None:
    result = world.ear.set_parameter("/cloud_switcher", "override", "Everywhere")
    assert not result.successful
    assert "Auto, Robot, Cloud" in result.reason


def test_the_override_outweighs_the_pin_of_the_resource_and_is_kept_over_a_restart(
    build: Callable[..., World],
) -> None:
    world = build(robot={"pin": "Robot"})
    world.start_agent("cloud")
    world.start_node("cloud")
    world.start_agent("robot")
    world.start_node("robot")
    world.until(lambda: world.reason == "PinnedToRobot" and world.site == "robot", "the pin of the resource counts")
    world.passes("robot")
    world.override("Cloud")
    world.goes_to("cloud")
    world.kill_agent("robot")
    world.start_agent("robot")
    world.goes_to("cloud")
    assert world.ear.get_parameter("/cloud_switcher", "override") == "Cloud"
    world.override("Auto")
    world.goes_to("robot")
    world.check()


def test_an_override_expires(world: World) -> None:
    asked(world, world.ear, "/guardian_activate_cloud_nodes")  # what was asked for by hand before holds on afterwards
    assert world.ear.set_parameter("/cloud_switcher", "override_for_s", 4.0).successful
    world.override("Robot")
    world.goes_to("robot")
    world.until(lambda: world.site == "cloud", "the override has expired")
    assert world.ear.get_parameter("/cloud_switcher", "override") == "Auto"
    assert world.ear.set_parameter("/cloud_switcher", "override_for_s", 0.0).successful
