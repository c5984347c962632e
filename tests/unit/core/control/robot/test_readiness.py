"""What a commanded change waits for besides nodes and outputs (handover, sections 4 and 8)."""

from __future__ import annotations

from robot_offload_core.control.nodes.rest import RELAY_GONE_S, Rest
from robot_offload_core.control.robot import readiness
from robot_offload_core.control.robot.placement import Handing, Preparation, RelayReported, Robot
from robot_offload_core.fence.grant import Grant
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import StateReported
from robot_offload_core.words.messages import RelayStatus
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Settings

POLICY = Verdict(Site.CLOUD, Reason.CLOUD_PREFERRED, "")
PIN = Verdict(Site.CLOUD, Reason.PINNED_TO_CLOUD, "")
PREPARATION = Preparation(6.0, patient_until_s=5.0)
LACKS = (("GoalsPending", "Goals not accepted yet"),)


def robot(*pending: tuple[str, str], epoch: int = 7, hold: str = "", served: bool = True) -> Robot:
    report = RelayReported(Token("1" * 32, epoch, "2" * 32), pending, hold, 10.0)
    granted = Grant("1" * 32, 0.0, epoch=6, last_epoch=7, candidate=7, cloud="2" * 32)
    state = Robot(granted, 0, Settings(), phase=Phase.TO_CLOUD, preparation=PREPARATION)
    return replace(state, handing=Handing(served, report))


def test_the_gate_is_armed_when_the_relay_says_that_all_is_there_for_this_very_preparation() -> None:
    assert readiness.may_arm(robot(), PREPARATION, POLICY, 1.0)
    assert not readiness.may_arm(robot(*LACKS), PREPARATION, POLICY, 1.0)
    assert not readiness.may_arm(robot(epoch=5), PREPARATION, POLICY, 1.0)
    assert not readiness.may_arm(replace(robot(), handing=Handing(True)), PREPARATION, POLICY, 1.0)
    assert readiness.may_arm(robot(*LACKS, served=False), PREPARATION, POLICY, 1.0)


def test_a_pin_waits_until_the_deadline_and_a_robot_that_cannot_act_for_nothing() -> None:
    lacking = robot(*LACKS)
    assert not readiness.may_arm(lacking, PREPARATION, PIN, 4.9)
    assert readiness.may_arm(lacking, PREPARATION, PIN, 5.0)
    assert not readiness.may_arm(lacking, PREPARATION, POLICY, 5.9)
    assert readiness.may_arm(lacking, replace(PREPARATION, need=True), POLICY, 0.0)


def test_a_change_waits_for_a_hold_goal_no_longer_than_its_hold_for() -> None:
    state, waits = readiness.hold(robot(hold="/wait"), POLICY, 1.0)
    assert waits
    assert readiness.hold(state, POLICY, 10.9)[1]
    assert not readiness.hold(state, POLICY, 11.0)[1]
    assert not readiness.hold(robot(hold="/wait"), PIN, 1.0)[1]
    assert not readiness.hold(robot(), POLICY, 1.0)[1]
    over, _ = readiness.hold(replace(state, handing=replace(state.handing, report=None)), POLICY, 2.0)
    assert over.handing.held_s is None


def test_a_new_hold_goal_calls_a_waiting_preparation_off_but_none_for_need_and_none_that_is_armed() -> None:
    _, why = readiness.interrupts(robot(hold="/wait"), POLICY, 1.0)
    assert why is not None
    assert why.reason is Reason.GOALS_PENDING
    for other in (replace(PREPARATION, need=True), replace(PREPARATION, armed=True)):
        assert readiness.interrupts(replace(robot(hold="/wait"), preparation=other), POLICY, 1.0)[1] is None


def status(*, busy: bool, holder: Site = Site.CLOUD, executing: tuple[str, ...] = ()) -> RelayStatus:
    return RelayStatus(None, (), "", busy, executing, holder=holder)


def test_nodes_stay_active_while_their_goals_end_but_not_beyond_the_deadline() -> None:
    rest = Rest(Site.ROBOT, 2.0)
    assert not rest.keeps_active(True, 10.0)
    assert not rest.keeps_active(False, 10.0)
    rest.take(status(busy=True), 10.0)
    assert rest.keeps_active(False, 10.1)
    rest.take(status(busy=True), 11.9)
    assert rest.keeps_active(False, 11.9)
    assert not rest.keeps_active(False, 12.0)
    rest.keeps_active(True, 20.0)
    rest.take(status(busy=False), 20.0)
    assert not rest.keeps_active(False, 20.0)


def test_a_relay_that_has_not_heard_of_the_change_keeps_what_it_executes_for_a_moment() -> None:
    rest = Rest(Site.ROBOT, 2.0)
    rest.keeps_active(True, 10.0)
    rest.take(status(busy=False, holder=Site.ROBOT, executing=("/a",)), 10.0)
    assert rest.keeps_active(False, 10.05)
    assert not rest.keeps_active(False, 10.2)


def test_a_relay_that_died_holds_nothing_back() -> None:
    rest = Rest(Site.ROBOT, 2.0)
    rest.keeps_active(True, 10.0)
    rest.take(status(busy=True), 10.0)
    assert not rest.keeps_active(False, 10.1 + RELAY_GONE_S)


def test_a_side_that_was_called_off_for_its_goals_settles_and_then_sleeps() -> None:
    rest = Rest(Site.ROBOT, 2.0)
    rest.keeps_active(True, 10.0)
    rest.settle(20.0)
    assert rest.keeps_active(False, 19.9)
    assert not rest.keeps_active(False, 20.0)
    rest.settle(40.0)
    rest.keeps_active(True, 30.0)
    assert not rest.keeps_active(False, 30.1), "it acted meanwhile"


def keeping(*states: StateReported) -> Robot:
    state = robot(served=False)
    return replace(state, handing=replace(state.handing, kept=True, states=states))


def test_the_gate_waits_for_the_state_of_the_side_that_gets_ready_and_of_this_very_preparation() -> None:
    assert not readiness.may_arm(keeping(), PREPARATION, POLICY, 1.0)
    assert not readiness.may_arm(keeping(StateReported(Site.CLOUD, 5)), PREPARATION, POLICY, 1.0)
    assert not readiness.may_arm(keeping(StateReported(Site.ROBOT, 7)), PREPARATION, POLICY, 1.0)
    stale = keeping(StateReported(Site.CLOUD, 7, ("no snapshot",)))
    assert not readiness.may_arm(stale, PREPARATION, POLICY, 1.0)
    why = readiness.pending(stale, PREPARATION)
    assert why is not None
    assert (why.reason, why.message) == (Reason.STATE_STALE, "no snapshot")
    assert readiness.may_arm(keeping(StateReported(Site.CLOUD, 7)), PREPARATION, POLICY, 1.0)
    assert readiness.may_arm(stale, PREPARATION, PIN, 5.0), "a pin waits until the deadline only"
    assert readiness.may_arm(stale, replace(PREPARATION, need=True), POLICY, 0.0)


UNKNOWN = ("no snapshot",)
HAND, LEAVING = Verdict(Site.CLOUD, Reason.BY_HAND, ""), Verdict(Site.ROBOT, Reason.POD_STOPPING, "")
BACK = Verdict(Site.ROBOT, Reason.LATENCY_TOO_HIGH, "")
WAIT_S = Settings().preparing_s


def knowing(*unknown: str, lacking: tuple[str, ...] = ()) -> Robot:
    """Returns a robot whose data processes say what each side does not know before its nodes wake."""
    state = replace(keeping(*(StateReported(site, 0, unknown + lacking, unknown) for site in Site)), phase=Phase.ROBOT)
    return replace(state, preparation=None)


def begins(state: Robot, wish: Verdict, *times_s: float) -> list[bool]:
    """Returns at which of the times a change begins."""
    begun = []
    for now_s in times_s:
        state, lacks = readiness.begins(state, wish, now_s)
        begun.append(lacks is None)
    return begun


def test_the_policy_wakes_the_clouds_nodes_only_when_there_is_state_to_wake_with() -> None:
    assert begins(knowing(*UNKNOWN), POLICY, 1.0, 100.0) == [False, False]
    assert begins(keeping(), POLICY, 1.0, 100.0) == [False, False], "a data process that has said nothing knows nothing"
    _, lacks = readiness.begins(knowing(*UNKNOWN), POLICY, 1.0)
    assert lacks is not None
    assert (lacks.site, lacks.reason, lacks.message) == (Site.ROBOT, Reason.STATE_STALE, "no snapshot")
    assert begins(knowing(), POLICY, 1.0) == [True]
    assert begins(knowing(lacking=("parameters",)), POLICY, 1.0) == [True], "what is given to Active nodes only"
    assert begins(robot(served=False), POLICY, 1.0) == [True], "no state is declared"


def test_a_person_and_a_way_back_wait_for_state_no_longer_than_a_preparation_takes_and_a_veto_not_at_all() -> None:
    for wish in (PIN, HAND, BACK):
        assert begins(knowing(*UNKNOWN), wish, 1.0, 0.99 + WAIT_S, 1.0 + WAIT_S) == [False, False, True]
    assert begins(knowing(*UNKNOWN), LEAVING, 1.0) == [True]


def test_what_a_person_has_waited_for_before_a_preparation_is_not_waited_for_in_it() -> None:
    state, _ = readiness.begins(knowing(*UNKNOWN), PIN, 1.0)
    state = replace(state, phase=Phase.TO_CLOUD, preparation=PREPARATION)
    assert readiness.may_arm(state, PREPARATION, PIN, 1.0 + WAIT_S)
    assert not readiness.may_arm(state, PREPARATION, POLICY, 1.0 + WAIT_S)
    assert not readiness.may_arm(readiness.content(state), PREPARATION, PIN, 1.0 + WAIT_S)


def test_each_wait_for_state_counts_from_its_own_beginning() -> None:
    state, _ = readiness.begins(knowing(*UNKNOWN), PIN, 1.0)
    again, lacks = readiness.begins(readiness.content(state), PIN, 1.0 + WAIT_S)
    assert lacks is not None
    known, lacks = readiness.begins(replace(again, handing=knowing().handing), PIN, 2.0)
    assert lacks is None
    assert known.handing.lacked_s is None
