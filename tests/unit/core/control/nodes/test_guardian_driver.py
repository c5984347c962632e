"""The CORE rule: the driver is inhibited while a CORE node that should act does not, and released when all is well."""

from __future__ import annotations

import itertools

import pytest

from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.control.nodes.guardians import INHIBIT_PERIOD_S, InhibitAnswered
from robot_offload_core.control.nodes.managed_nodes import Inhibit
from robot_offload_core.words.events import Acting
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec
from tests.unit.core.shift import GRACE_S, STEP_S, Shift

CONTROLLER, MAP = NodeSpec("controller", core=True), NodeSpec("map")
BASE = NodeSpec("base", duplicated=False, core=True)


def on_duty(*specs: NodeSpec, acting: bool = True) -> Shift:
    """A second of duty with the driver released."""
    shift = Shift(*(specs or (CONTROLLER,)), driver=True)
    shift.act(acting)
    shift.run(1.0)
    assert shift.driver is False
    shift.forget()
    return shift


def fail(shift: Shift, name: str = "controller") -> float:
    """A node falls back to inactive and refuses; returns when."""
    shift.stubborn.add(name)
    shift.states[name] = State.INACTIVE
    shift.happen(managed_nodes.Observed(name, State.INACTIVE))
    return shift.now_s


def first_inhibit_s(shift: Shift) -> float | None:
    return next((t for t, c in shift.log if isinstance(c, Inhibit) and c.inhibit), None)


# -- grace


def test_a_core_node_may_be_on_its_way_for_the_grace_time() -> None:
    shift = on_duty()
    failed_s = fail(shift)
    shift.run(GRACE_S - 2 * STEP_S)
    assert first_inhibit_s(shift) is None
    shift.run(4 * STEP_S)
    inhibited_s = first_inhibit_s(shift)
    assert inhibited_s is not None
    assert inhibited_s - failed_s == pytest.approx(GRACE_S, abs=2 * STEP_S)


def test_a_core_node_that_recovers_within_the_grace_stops_nobody() -> None:
    shift = on_duty()
    fail(shift)
    shift.stubborn.clear()
    shift.run(2.0)
    assert shift.inhibits() == []


def test_the_reason_names_the_node_and_its_state() -> None:
    shift = on_duty()
    fail(shift)
    shift.run(0.5)
    assert [c.reason for _, c in shift.log if isinstance(c, Inhibit)] == ["CORE node controller is inactive"]


def test_each_time_in_charge_earns_a_new_grace() -> None:
    shift = on_duty(acting=False)
    shift.act()
    assert first_inhibit_s(shift) is None
    shift.run(0.1)
    assert first_inhibit_s(shift) is None


def test_a_second_fault_in_a_row_earns_no_second_grace() -> None:
    shift = on_duty(CONTROLLER, BASE)
    fail(shift)
    shift.run(GRACE_S + 0.1)
    fail(shift, "base")
    shift.stubborn.discard("controller")
    shift.run(1.0)
    assert shift.driver is True
    assert {said for _, said in shift.inhibits()} == {True}


def test_what_the_driver_may_have_served_last_in_spite_of_our_last_word_is_said_again_at_once() -> None:
    shift = on_duty()
    for last in (True, False):
        shift.happen(Acting(True, in_charge=True, stop="a veto" if last else ""))
        assert shift.driver is last
        shift.forget()
        shift.happen(InhibitAnswered(not last))
        assert [said for _, said in shift.inhibits()] == [last]
        shift.forget()
        shift.happen(InhibitAnswered(last))
        assert shift.inhibits() == []


# -- who is concerned


def test_a_node_that_is_not_core_inhibits_nobody() -> None:
    shift = on_duty(MAP, CONTROLLER)
    fail(shift, "map")
    shift.run(2.0)
    assert shift.inhibits() == []


def test_a_duplicated_core_node_asleep_while_the_other_side_acts_inhibits_nobody() -> None:
    shift = on_duty()
    shift.act(False)
    shift.run(3.0)
    assert shift.states["controller"] is State.INACTIVE
    assert shift.inhibits() == []


def test_a_side_that_only_gets_ready_inhibits_nobody() -> None:
    shift = on_duty(acting=False)
    shift.stubborn.add("controller")
    shift.act(in_charge=False, flow=False)
    shift.run(3.0)
    assert shift.inhibits() == []


def test_a_core_node_of_this_side_alone_inhibits_whoever_acts() -> None:
    shift = on_duty(BASE, acting=False)
    fail(shift, "base")
    shift.run(0.5)
    assert shift.driver is True


def test_a_side_without_a_driver_inhibits_nobody() -> None:
    shift = Shift(CONTROLLER)
    shift.stubborn.add("controller")
    shift.act()
    shift.run(5.0)
    assert shift.inhibits() == []


def test_a_silent_rated_output_of_the_side_in_charge_inhibits_at_once() -> None:
    shift = on_duty()
    shift.act(flow=False)
    assert shift.driver is True
    assert guardians.core_fault(shift.guardian) == "The robot's rated outputs are silent"
    shift.act(flow=True)
    assert shift.driver is False


# -- said and confirmed


def test_an_inhibit_is_repeated_until_the_driver_confirms_it() -> None:
    shift = on_duty()
    shift.driver_up = False
    fail(shift)
    shift.run(GRACE_S + 2.2)
    said_s = [t for t, inhibit in shift.inhibits() if inhibit]
    assert len(said_s) == 5
    gaps_s = [after - before for before, after in itertools.pairwise(said_s)]
    assert gaps_s == pytest.approx([INHIBIT_PERIOD_S] * 4, abs=2 * STEP_S)


def test_a_standing_inhibit_is_repeated_for_a_driver_that_restarts() -> None:
    shift = on_duty()
    fail(shift)
    shift.run(0.5)
    assert shift.driver is True
    shift.driver = None  # restarted: it has forgotten
    shift.run(2 * INHIBIT_PERIOD_S)
    assert shift.driver is True


def test_the_driver_is_released_as_soon_as_all_is_well() -> None:
    shift = on_duty()
    fail(shift)
    shift.run(1.0)
    shift.stubborn.clear()
    shift.run(6.0)
    assert shift.states["controller"] is State.ACTIVE
    assert [said for _, said in shift.inhibits()][-1] is False
    assert shift.driver is False


def test_a_release_is_repeated_until_confirmed_and_then_no_more() -> None:
    shift = on_duty()
    fail(shift)
    shift.run(1.0)
    shift.driver_up = False
    shift.stubborn.clear()
    shift.run(5.0)
    assert [said for _, said in shift.inhibits()].count(False) > 2
    shift.driver_up = True
    shift.run(1.0)
    assert shift.driver is False
    shift.forget()
    shift.run(5.0)
    assert shift.inhibits() == []


def test_a_late_confirmation_of_an_older_request_does_not_count_for_the_newer() -> None:
    shift = on_duty()
    fail(shift)
    shift.run(1.0)
    shift.driver_up = False
    shift.stubborn.clear()
    shift.run(3.0)
    shift.forget()
    shift.happen(InhibitAnswered(True))
    shift.run(1.0)
    assert [said for _, said in shift.inhibits()] == [False, False]


def test_losing_charge_to_a_healthy_cloud_releases_the_driver() -> None:
    shift = on_duty()
    fail(shift)
    shift.run(1.0)
    shift.act(False)
    shift.run(0.5)
    assert shift.driver is False


def test_a_driver_inhibited_for_silence_is_released_for_messages_and_not_for_grace() -> None:
    shift = on_duty()
    shift.act(flow=False)
    shift.run(0.1)
    assert shift.driver is True
    shift.happen(Acting(True, outputs_flow=True, outputs_heard=False))
    shift.run(2.0)
    assert shift.driver is True
    shift.happen(Acting(True, outputs_flow=True, outputs_heard=True))
    assert shift.driver is False


def test_outputs_that_were_not_heard_yet_stop_no_driver_that_is_free() -> None:
    shift = on_duty()
    shift.happen(Acting(True, outputs_flow=True, outputs_heard=False))
    shift.run(2.0)
    assert shift.driver is False


# -- the first word


def test_the_first_word_is_a_release_and_is_said_once_all_is_well() -> None:
    shift = Shift(CONTROLLER, driver=True)
    shift.slow_s = {"controller": 0.050}
    shift.act()
    shift.run(1.0)
    assert [said for _, said in shift.inhibits()] == [False]


def test_a_driver_that_an_earlier_guardian_inhibited_is_not_released_before_all_is_well() -> None:
    shift = Shift(CONTROLLER, driver=True)
    shift.slow_s = {"controller": 0.100}
    shift.act()
    shift.run(0.150)
    assert shift.inhibits() == []
    shift.run(0.850)
    assert shift.driver is False


def test_a_node_that_never_comes_up_inhibits_after_the_grace_also_at_the_start() -> None:
    shift = Shift(CONTROLLER, driver=True, state=State.UNKNOWN)
    shift.act()
    shift.run(0.5)
    assert shift.driver is True


def test_a_strict_veto_stops_the_driver_at_once_also_while_the_cloud_acts() -> None:
    shift = Shift(CONTROLLER, driver=True)
    shift.act(False)
    shift.run(1.0)
    assert shift.driver is False
    shift.happen(Acting(False, in_charge=False, stop="a second publisher"))
    assert shift.driver is True
    shift.happen(Acting(False, in_charge=False))
    assert shift.driver is False
