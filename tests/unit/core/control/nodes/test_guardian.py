"""Lifecycle: the order of bring-up and sleep, retries that wait longer, reads before retries, new chances."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.control.nodes import guardians
from robot_offload_core.control.nodes.guardians import Flowing, Seen
from robot_offload_core.control.nodes.managed_nodes import (
    GIVE_UP_S,
    READ_DEADLINE_S,
    READ_PERIOD_S,
    TRANSITION_DEADLINE_S,
    Answered,
    ChangeState,
    GetState,
    NodeNews,
    Observed,
    Transition,
)
from robot_offload_core.words.events import Acting
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec
from tests.unit.core.builders import NOW_S, few
from tests.unit.core.shift import STEP_S, Shift

MAP, PLANNER, CONTROLLER = NodeSpec("map"), NodeSpec("planner"), NodeSpec("controller", core=True)
BASE = NodeSpec("base", duplicated=False)
CORES = tuple(NodeSpec(name, core=True) for name in ("map", "planner", "controller"))
HOT = NodeSpec("hot", hot=True)
PLAIN = NodeSpec("plain", lifecycle=False, core=True)


def states(shift: Shift) -> list[State]:
    return [node.state for node in shift.guardian.nodes]


def awake(*specs: NodeSpec) -> Shift:
    """On duty, all nodes up, this side acts."""
    shift = Shift(*specs)
    shift.act()
    shift.run(1.0)
    assert states(shift) == [State.ACTIVE if s.lifecycle else State.UNKNOWN for s in specs]
    shift.forget()
    return shift


def asleep(*specs: NodeSpec) -> Shift:
    """On duty, all nodes configured, the other side acts."""
    shift = Shift(*specs)
    shift.run(1.0)
    shift.forget()
    return shift


# -- order


def test_bring_up_follows_the_order_of_the_list() -> None:
    shift = Shift(*CORES)
    shift.act()
    shift.run(1.0)
    assert shift.asked() == [
        (name, step) for name in ("map", "planner", "controller") for step in ("configure", "activate")
    ]


def test_waking_from_inactive_follows_the_order_too() -> None:
    shift = asleep(*CORES)
    shift.act()
    shift.run(1.0)
    assert shift.asked() == [(name, "activate") for name in ("map", "planner", "controller")]


def test_a_core_node_waits_for_core_nodes_only() -> None:
    shift = Shift(MAP, PLANNER, CONTROLLER)
    shift.slow_s = {"map": 0.5}
    shift.act()
    shift.run(0.2)
    assert states(shift)[2] is State.ACTIVE
    assert ("planner", "configure") not in shift.asked(), "a node that is not CORE waits for all before it"


@pytest.mark.parametrize("core", [True, False], ids=["CORE", "not CORE"])
@pytest.mark.parametrize("state", [State.UNKNOWN, State.FINALIZED])
def test_a_dead_node_holds_up_nobody(state: State, core: bool) -> None:
    shift = Shift(NodeSpec("map", core=core), CONTROLLER)
    shift.states["map"] = state
    shift.act()
    shift.run(1.5)
    assert shift.states["controller"] is State.ACTIVE
    assert guardians.degraded(shift.guardian) == (() if core else ("map",))


def test_a_node_that_refuses_holds_up_nobody_after_its_first_attempt() -> None:
    shift = Shift(NodeSpec("map", core=True), PLANNER, CONTROLLER)
    shift.stubborn = {"map", "planner"}
    shift.act()
    shift.run(0.3)
    assert shift.states["controller"] is State.ACTIVE
    assert guardians.degraded(shift.guardian) == ("planner",)


def test_a_node_that_refuses_to_sleep_lets_the_others_sleep() -> None:
    shift = awake(MAP, CONTROLLER)
    shift.stubborn = {"controller"}
    shift.act(False)
    shift.run(0.5)
    assert shift.states["map"] is State.INACTIVE


def test_nodes_of_the_cloud_alone_are_always_active_there_and_no_part_of_its_readiness() -> None:
    shift = Shift(NodeSpec("navigator", duplicated=False), CONTROLLER)
    shift.states["navigator"] = State.UNKNOWN
    shift.act()
    shift.run(1.5)
    assert guardians.is_ready(shift.guardian)
    shift.states["navigator"] = State.UNCONFIGURED
    shift.act(False)
    shift.run(2.0)
    assert shift.states == {"navigator": State.ACTIVE, "controller": State.INACTIVE}


def test_a_busy_node_whose_rated_outputs_flow_is_not_dead() -> None:
    shift = awake(CONTROLLER, MAP)
    shift.happen(Flowing(("controller",)))
    shift.states = dict.fromkeys(shift.states, State.UNKNOWN)  # both in a long callback: no read is answered
    shift.run(5.0)
    assert states(shift) == [State.ACTIVE, State.UNKNOWN]
    shift.happen(Flowing(()))
    shift.run(2.0)
    assert states(shift) == [State.UNKNOWN, State.UNKNOWN]


def test_going_to_sleep_is_in_reverse() -> None:
    shift = awake(MAP, PLANNER, CONTROLLER)
    shift.act(False)
    shift.run(1.0)
    assert shift.asked() == [(name, "deactivate") for name in ("controller", "planner", "map")]
    assert states(shift) == [State.INACTIVE] * 3


def test_each_node_waits_for_the_one_before_it() -> None:
    shift = Shift(CORES[0], CONTROLLER)
    shift.slow_s = {"map": 0.5}
    shift.act()
    shift.run(0.9)
    assert shift.asked() == [("map", "configure"), ("map", "activate")]
    shift.run(0.5)
    assert states(shift) == [State.ACTIVE, State.ACTIVE]


def test_the_first_to_sleep_holds_up_the_next() -> None:
    shift = awake(MAP, CONTROLLER)
    shift.slow_s = {"controller": 0.5}
    shift.act(False)
    shift.run(0.4)
    assert shift.asked() == [("controller", "deactivate")]


def test_a_change_of_mind_while_a_node_is_on_its_way_waits_for_its_answer() -> None:
    shift = asleep(CONTROLLER)
    shift.slow_s = {"controller": 0.3}
    shift.act()
    shift.run(0.1)
    shift.act(False)
    shift.run(1.0)
    assert shift.asked() == [("controller", "activate"), ("controller", "deactivate")]
    assert states(shift) == [State.INACTIVE]


def test_a_standby_is_configured_so_that_it_wakes_quickly() -> None:
    assert states(asleep(MAP, CONTROLLER)) == [State.INACTIVE, State.INACTIVE]


def test_a_node_of_this_side_alone_is_active_whoever_acts() -> None:
    assert states(asleep(BASE, CONTROLLER)) == [State.ACTIVE, State.INACTIVE]


def test_a_hot_standby_is_active_while_the_other_side_acts_and_stays_so() -> None:
    shift = asleep(HOT, CONTROLLER)
    assert states(shift) == [State.ACTIVE, State.INACTIVE]
    for acting in (True, False):
        shift.act(acting)
        shift.run(0.5)
    assert ("hot", "deactivate") not in shift.asked()
    assert states(shift) == [State.ACTIVE, State.INACTIVE]


def test_a_program_without_a_lifecycle_is_left_alone() -> None:
    shift = Shift(PLAIN, CONTROLLER)
    shift.act()
    shift.run(1.0)
    assert {c.name for _, c in shift.log if isinstance(c, ChangeState | GetState)} == {"controller"}
    assert states(shift)[1] is State.ACTIVE


def test_an_active_side_is_left_in_peace() -> None:
    shift = awake(MAP, CONTROLLER)
    shift.run(10.0)
    assert shift.asked() == []


# -- ready


@pytest.mark.parametrize(
    ("specs", "active", "ready"),
    [
        ((MAP, CONTROLLER), {"controller"}, True),
        ((MAP, CONTROLLER), {"map"}, False),
        ((MAP, PLANNER), {"map"}, False),
        ((MAP, PLANNER), {"map", "planner"}, True),
        ((BASE,), set(), True),
        ((NodeSpec("base", duplicated=False, core=True), CONTROLLER), {"controller"}, True),
        ((PLAIN,), set(), False),
        ((PLAIN,), {"plain"}, True),
        ((), set(), True),
    ],
    ids=["CORE is enough", "CORE is missing", "no CORE: all count", "all there", "nothing duplicated",
         "CORE of this side alone", "no lifecycle, unseen", "no lifecycle, seen", "no nodes"],
)  # fmt: skip
def test_a_side_is_ready_when_its_duplicated_core_nodes_are_active(
    specs: tuple[NodeSpec, ...], active: set[str], ready: bool
) -> None:
    guardian, _ = guardians.step(guardians.start(specs, 0.25), Acting(True), NOW_S)
    for name in active:
        guardian, _ = guardians.step(guardian, Observed(name, State.ACTIVE), NOW_S)
    assert guardians.is_ready(guardian) is ready


def test_a_side_whose_node_is_being_deactivated_is_not_ready_although_it_shall_act_again() -> None:
    guardian, _ = guardians.step(guardians.start((CONTROLLER,), 0.25), Acting(True), NOW_S)
    guardian, _ = guardians.step(guardian, Observed("controller", State.ACTIVE), NOW_S)
    guardian, commands = guardians.step(guardian, Acting(False), NOW_S)
    assert [c.transition for c in commands if isinstance(c, ChangeState)] == [Transition.DEACTIVATE]
    guardian, _ = guardians.step(guardian, Acting(True), NOW_S)
    assert not guardians.is_ready(guardian)


def test_a_node_without_a_lifecycle_is_gone_when_two_looks_do_not_find_it() -> None:
    guardian, _ = guardians.step(guardians.start((PLAIN,), 0.25), Seen(("plain",)), NOW_S)
    assert guardians.is_ready(guardian)
    guardian, _ = guardians.step(guardian, Seen(()), NOW_S + 0.5)
    assert guardians.is_ready(guardian), "one look may come amid a discovery"
    guardian, _ = guardians.step(guardian, Seen(()), NOW_S + 1.0)
    assert not guardians.is_ready(guardian)


# -- refusals


def test_retries_of_a_refused_transition_wait_twice_as_long_each_time() -> None:
    shift = asleep(CONTROLLER)
    shift.stubborn = {"controller"}
    shift.act()
    shift.run(25.0)
    asked_s = shift.asked_s("controller")
    waits_s = [after - before for before, after in itertools.pairwise(asked_s)]
    assert waits_s[:8] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0], abs=4 * STEP_S)


def test_after_a_minute_of_refusals_the_node_is_given_up_with_the_reason() -> None:
    shift = asleep(CONTROLLER)
    shift.stubborn = {"controller"}
    shift.act()
    shift.run(GIVE_UP_S + 20.0)
    gave_up = [c for _, c in shift.log if isinstance(c, NodeNews) and c.reason == "GaveUp"]
    assert len(gave_up) == 1
    assert gave_up[0].message.startswith("activate was refused, ")
    assert gave_up[0].message.endswith("restart the node or switch again to retry")
    shift.forget()
    shift.run(60.0)
    assert shift.asked() == []


def given_up() -> Shift:
    shift = asleep(CONTROLLER)
    shift.stubborn = {"controller"}
    shift.act()
    shift.run(GIVE_UP_S + 20.0)
    shift.stubborn.clear()
    shift.forget()
    return shift


def test_a_node_that_was_given_up_gets_a_new_chance_when_it_restarts() -> None:
    shift = given_up()
    shift.restart("controller")
    shift.run(0.5)
    assert shift.asked() == [("controller", "configure"), ("controller", "activate")]
    assert states(shift) == [State.ACTIVE]


def test_a_node_that_was_given_up_gets_a_new_chance_at_the_next_switch() -> None:
    shift = given_up()
    shift.act(False)
    shift.act()
    shift.run(0.5)
    assert states(shift) == [State.ACTIVE]


def test_a_node_that_was_given_up_does_not_hold_up_the_others() -> None:
    shift = asleep(MAP, CONTROLLER)
    shift.stubborn = {"map"}
    shift.act()
    shift.run(GIVE_UP_S + 20.0)
    assert states(shift) == [State.INACTIVE, State.ACTIVE]


def test_one_success_makes_the_waits_short_again() -> None:
    shift = asleep(CONTROLLER)
    shift.stubborn = {"controller"}
    shift.act()
    shift.run(5.0)
    shift.stubborn.clear()
    shift.run(5.0)
    node = shift.guardian.nodes[0]
    assert (node.state, node.failures, node.failing_since_s, node.retry_s) == (State.ACTIVE, 0, None, 0.0)


def test_an_answer_to_something_that_was_not_asked_is_ignored() -> None:
    shift = asleep(CONTROLLER)
    before = shift.guardian
    shift.happen(Answered("controller", Transition.ACTIVATE, True))
    assert shift.guardian == before


# -- silence


def test_a_transition_without_an_answer_is_followed_by_a_read_not_by_a_retry() -> None:
    shift = asleep(CONTROLLER)
    shift.mute = {"controller"}
    shift.states["controller"] = State.UNKNOWN  # from now on it does not answer at all
    shift.act()
    shift.run(TRANSITION_DEADLINE_S + READ_DEADLINE_S + 5.0)
    assert shift.asked() == [("controller", "activate")]
    assert "TransitionFailed" in shift.reasons("controller")


def test_a_transition_that_was_done_without_an_answer_is_not_asked_for_again() -> None:
    shift = asleep(CONTROLLER)
    shift.mute = {"controller"}
    shift.act()
    shift.run(10.0)
    assert shift.asked() == [("controller", "activate")]
    assert states(shift) == [State.ACTIVE]
    assert "TransitionFailed" not in shift.reasons("controller"), "a read while it is under way finds it done"


def test_a_transition_that_is_done_only_after_its_deadline_is_found_done_by_the_read() -> None:
    shift = asleep(CONTROLLER)
    shift.slow_s = {"controller": TRANSITION_DEADLINE_S + 0.5}
    shift.mute = {"controller"}
    shift.act()
    shift.run(TRANSITION_DEADLINE_S - 0.1)
    shift.states["controller"] = State.UNKNOWN  # busy: it answers nothing while it works
    shift.run(0.5)
    shift.states["controller"] = State.ACTIVE
    shift.run(3.0)
    assert shift.asked() == [("controller", "activate")]
    assert states(shift) == [State.ACTIVE]


def test_a_node_that_died_is_noticed_by_a_read_and_reported() -> None:
    shift = awake(CONTROLLER)
    shift.states["controller"] = State.UNKNOWN
    shift.run(READ_PERIOD_S + READ_DEADLINE_S + 2 * STEP_S)
    assert states(shift) == [State.UNKNOWN]
    assert shift.reasons("controller") == ["StateChanged"]


def test_a_node_that_restarted_unnoticed_is_brought_up_again() -> None:
    shift = awake(CONTROLLER)
    shift.restart("controller")
    shift.run(0.5)
    assert shift.asked() == [("controller", "configure"), ("controller", "activate")]
    assert "NodeRestarted" in shift.reasons("controller")


def test_a_node_that_comes_up_late_is_found_and_brought_up() -> None:
    shift = Shift(CONTROLLER, state=State.UNKNOWN)
    shift.act()
    shift.run(7.0)
    shift.states["controller"] = State.UNCONFIGURED
    shift.run(READ_DEADLINE_S + 0.5)
    assert states(shift) == [State.ACTIVE]


def test_a_finalized_node_is_asked_for_nothing() -> None:
    shift = Shift(CONTROLLER, state=State.FINALIZED)
    shift.act()
    shift.run(10.0)
    assert shift.asked() == []
    assert states(shift) == [State.FINALIZED]


def test_somebody_elses_transition_is_put_right() -> None:
    shift = awake(CONTROLLER)
    shift.states["controller"] = State.INACTIVE
    shift.run(READ_PERIOD_S + 0.5)
    assert shift.asked() == [("controller", "activate")]


# -- whatever happens

lives = st.lists(
    st.tuples(
        st.sampled_from(["act", "sleep", "kill", "start", "stubborn", "obedient", "mute", "slow"]),
        st.sampled_from(["map", "planner", "controller"]),
        st.floats(0, 3),
    ),
    max_size=12,
)


@few
@given(lives)
def test_at_most_one_transition_of_a_node_is_under_way_and_all_is_well_when_faults_have_ceased(
    life: list[tuple[str, str, float]],
) -> None:
    shift = Shift(MAP, PLANNER, CONTROLLER)
    for what, name, wait_s in life:
        if what in ("act", "sleep"):
            shift.act(what == "act")
        elif what == "kill":
            shift.states[name] = State.UNKNOWN
        elif what == "start" and shift.states[name] is State.UNKNOWN:
            shift.states[name] = State.UNCONFIGURED
        elif what == "stubborn":
            shift.stubborn.add(name)
        elif what == "mute":
            shift.mute.add(name)
        elif what == "slow":
            shift.slow_s[name] = 0.7
        else:
            shift.stubborn.discard(name)
            shift.mute.discard(name)
        shift.run(wait_s)
    shift.stubborn.clear()
    shift.mute.clear()
    for name, state in shift.states.items():
        shift.states[name] = State.UNCONFIGURED if state is State.UNKNOWN else state
    shift.run(30.0)
    wished = State.ACTIVE if shift.guardian.acting else State.INACTIVE
    assert list(shift.states.values()) == [wished] * 3
    assert states(shift) == [wished] * 3
    assert_one_at_a_time(shift)


def assert_one_at_a_time(shift: Shift) -> None:
    """Between two transitions of one node lies an answer, or the deadline."""
    for name in shift.states:
        asked_s = [t for t, c in shift.log if isinstance(c, ChangeState) and c.name == name]
        ended_s = [
            t for t, c in shift.log
            if isinstance(c, NodeNews) and c.name == name and c.reason in ("StateChanged", "TransitionFailed", "GaveUp")
        ]  # fmt: skip
        for before, after in itertools.pairwise(asked_s):
            assert any(before <= end <= after for end in ended_s)
