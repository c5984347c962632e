"""Stories of service calls over changes of the holder (handover, section 3)."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_sim.sides.clients import ClientCall
from robot_offload_sim.stories.goal_stage import CLEAR, COUNT, LAMP, PLAN, GoalStage

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD


def _wait(stage: GoalStage, call: ClientCall, within_s: float = 4.0) -> None:
    stage.until(lambda: bool(call.answers or call.failures), within_s, f"call {call.number} is decided")


def call_in_a_change() -> None:
    """A commanded change leaves requests where they are: the old side answers, and none is executed twice."""
    stage = GoalStage()
    stage.in_cloud()
    stage.traits(CLOUD, PLAN).call_s = 1.0
    call = stage.clients.call(PLAN)
    stage.run(0.1)
    stage.to(ROBOT)
    stage.expect(not call.answers, "the change came first")
    _wait(stage, call)
    stage.expect(bool(call.answers), "the old side answered")
    stage.expect([site for site, *_ in call.executed] == [CLOUD], "executed once, in the cloud")


def calls_at_a_loss() -> None:
    """Nobody knows whether the cloud executed: `Holder` fails, `Idempotent` is asked again on the robot."""
    stage = GoalStage()
    stage.in_cloud()
    for service in (PLAN, COUNT):
        stage.traits(CLOUD, service).call_s = 0.5
    plan, count = stage.clients.call(PLAN), stage.clients.call(COUNT)
    stage.run(0.1)
    stage.lose_cloud()
    _wait(stage, plan)
    _wait(stage, count)
    stage.expect(plan.failures == ["Unknown"], "the caller hears that nobody knows")
    stage.expect(bool(count.answers), "the query is answered")
    stage.expect([site for site, *_ in count.executed] == [CLOUD, ROBOT], "by the new holder")
    stage.run(2.0)


def relay_dies_between_execution_and_answer() -> None:
    """The cloud's relay is started again after its server executed: the call is not executed again."""
    stage = GoalStage()
    stage.in_cloud()
    stage.pin(CLOUD)
    stage.traits(CLOUD, PLAN).call_s = 0.2
    call = stage.clients.call(PLAN)
    stage.until(lambda: bool(call.executed), 1.0, "the cloud executes")
    stage.handing.cloud.kill(0.1)
    _wait(stage, call)
    stage.run(1.0)
    stage.expect(len(call.executed) == 1, "executed once")


def robots_relay_dies_with_calls() -> None:
    """The robot's relay dies: what its callers get is defined, and executed once."""
    stage = GoalStage()
    stage.in_cloud()
    stage.traits(CLOUD, PLAN).call_s = 0.4
    call = stage.clients.call(PLAN)
    stage.until(lambda: bool(call.executed), 1.0, "the cloud executes")
    stage.handing.robot.kill(0.1)
    _wait(stage, call)
    stage.run(1.0)
    stage.expect(call.failures == ["RelayRestarted"], "the caller hears it")


def late_copy_after_not_holder() -> None:
    """A request that was refused and is under way a second time is not admitted later."""
    stage = GoalStage()
    stage.in_cloud()
    stage.pin(CLOUD)
    wire = stage.link.data.up
    wire.doubled = 1.0
    calls = []
    for _ in range(20):
        calls.append(stage.clients.call(PLAN))
        stage.run(0.1)
    stage.pin(ROBOT)
    for _ in range(20):
        calls.append(stage.clients.call(PLAN))
        stage.run(0.1)
    stage.pin(CLOUD)
    stage.run(5.0)
    for call in calls:
        _wait(stage, call)


def calls_on_a_bad_link() -> None:
    """Requests and answers are lost, doubled, overtake each other: each is executed and answered once."""
    stage = GoalStage()
    stage.in_cloud()
    stage.pin(CLOUD)
    for wire in (stage.link.data.up, stage.link.data.down):
        wire.ordered = False
        wire.losses.append(0.3)
        wire.doubled = 0.5
        wire.reordering += 1
    calls = [stage.clients.call(PLAN) for _ in range(30)]
    for call in calls:
        _wait(stage, call)
    stage.expect(sum(bool(call.answers) for call in calls) >= 25, "nearly all are answered in time")


def both_before_the_change() -> None:
    """`Both`: the candidate executes the newest call after its nodes are Active and before the change."""
    stage = GoalStage()
    stage.in_cloud()
    old, new = stage.clients.call(CLEAR), stage.clients.call(CLEAR)
    _wait(stage, new)
    flipped: list[bool] = []
    stage.by_hand(ROBOT)
    stage.until(lambda: stage.holder is ROBOT, 8.0, "the robot holds")
    flipped.append(ROBOT in [site for site, *_ in new.executed])
    stage.expect(flipped == [True], "it was executed before")
    stage.expect(ROBOT not in [site for site, *_ in old.executed], "only the newest")
    stage.expect(len(new.answers) == 1, "its caller heard one answer")


def both_after_a_loss() -> None:
    """`Both`: after a loss the robot executes the newest call at once."""
    stage = GoalStage()
    stage.in_cloud()
    call = stage.clients.call(CLEAR)
    _wait(stage, call)
    stage.lose_cloud()
    stage.until(lambda: ROBOT in [site for site, *_ in call.executed], 1.0, "the robot executes it")


def used_calls_of_the_holder() -> None:
    """A server outside is called by the holder only: a standby's call fails at once, a candidate's waits."""
    stage = GoalStage()
    stage.in_cloud()
    here, there = stage.clients.use(ROBOT, LAMP), stage.clients.use(CLOUD, LAMP)
    _wait(stage, here, 0.1)
    _wait(stage, there, 0.5)
    stage.expect(here.failures == ["Standby"], "the standby is refused")
    stage.expect(bool(there.answers), "the holder is served")
    stage.hush("robot")
    stage.by_hand(ROBOT)
    stage.until(lambda: stage.armed, 3.0, "the robot is ready")
    waits = stage.clients.use(ROBOT, LAMP)
    stage.run(0.3)
    stage.expect(not waits.answers and not waits.failures, "a candidate's call waits")
    stage.robot.nodes["controller"].hung = 0
    stage.until(lambda: stage.holder is ROBOT, 2.0, "the robot holds")
    _wait(stage, waits, 1.5)
    stage.expect(bool(waits.answers), "and is served after the change")


def used_calls_after_a_loss() -> None:
    """After a loss the robot's calls wait until the cloud has stopped for sure; the cloud's late ones are refused."""
    stage = GoalStage()
    stage.in_cloud()
    stage.link.data.up.base_s = stage.link.data.down.base_s = 0.15
    stage.clients.use(CLOUD, LAMP)
    stage.run(0.02)
    granted_s = stage.now
    stage.cut(sessions="pulse")
    stage.until(lambda: stage.holder is ROBOT, 2.0, "the robot takes over")
    late = stage.clients.use(CLOUD, LAMP)
    mine = stage.clients.use(ROBOT, LAMP)
    _wait(stage, mine, 2.0)
    stage.expect(bool(mine.answers), "the robot is served")
    began_s = next(at_s for site, _, at_s in stage.clients.used if site is ROBOT)
    stage.expect(began_s - granted_s >= 0.25, "not before the lease of the last grant has ended")
    stage.run(2.5)
    stage.expect(not late.answers, "the cloud is not")


def request_after_the_lease() -> None:
    """A request that reaches the cloud when its lease has ended is not executed there, but by the robot."""
    stage = GoalStage(drops=False)
    stage.in_cloud()
    stage.link.data.up.extra_s = 0.45
    call = stage.clients.call(PLAN)
    stage.run(0.01)
    stage.cut(sessions="pulse")
    _wait(stage, call)
    stage.run(1.0)
    stage.expect([site for site, *_ in call.executed] == [ROBOT], "executed by the robot alone")
    stage.expect(bool(call.answers), "the caller has its answer")


STORIES = (
    call_in_a_change, calls_at_a_loss, relay_dies_between_execution_and_answer, robots_relay_dies_with_calls,
    late_copy_after_not_holder, calls_on_a_bad_link, both_before_the_change, both_after_a_loss,
    used_calls_of_the_holder, used_calls_after_a_loss, request_after_the_lease,
)  # fmt: skip
