"""Stories of goals over changes of the holder: one rule of the handover each."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.words.declared import OnSwitch
from robot_offload_core.words.replace import replace
from robot_offload_sim.stories.goal_stage import DOCK, FOLLOW, RELAY, SPIN, GoalStage

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD
SUCCEEDED, ABORTED, CANCELED = GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED


def goal_over_twenty_changes() -> None:
    """Twenty changes, commanded and sudden: one handle, feedback that goes forward, one result."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    for turn in range(10):
        if turn % 2:
            join = stage.lose_cloud()
            stage.run(0.3)
            join()
        else:
            stage.pin(ROBOT)
            stage.until(lambda: stage.holder is ROBOT, 8.0, "the robot holds")
            stage.run(0.2)
        stage.pin(CLOUD)
        stage.until(lambda: stage.holder is CLOUD, 20.0, "the cloud holds")
        stage.run(0.3)
        stage.expect(goal.open, "the goal goes on")
        stage.expect(len(stage.copies(CLOUD, goal)) == 1, "one copy in the cloud")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)
    stage.expect({site for _, site, *_ in goal.fed} == {ROBOT, CLOUD}, "the client heard both sides")


def copy_before_the_change() -> None:
    """The candidate has the goal before the collector changes over, so feedback hardly pauses (rule 2)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    stage.traits(ROBOT).accept_s = 0.4
    stage.by_hand(ROBOT)
    stage.until(lambda: stage.holder is ROBOT, 6.0, "the robot holds")
    stage.expect(len(stage.copies(ROBOT, goal)) == 1, "its copy is executed at the very moment of the change")
    stage.run(0.1)
    before = len(goal.fed)
    stage.run(0.2)
    stage.expect(len(goal.fed) > before, "feedback goes on")
    stage.until(lambda: not stage.copies(CLOUD, goal), 2.0, "the cloud's copy ends")


def goal_that_the_candidate_rejects() -> None:
    """A change is called off when the candidate does not take the goal; the holder goes on (section 8)."""
    stage = GoalStage()
    stage.on_robot()
    goal = stage.goal()
    stage.traits(CLOUD).rejects += 1
    stage.pin(None)
    stage.always(lambda: stage.holder is ROBOT, 6.5, "the robot goes on")
    reasons = [decided.verdict.reason.value for _, decided in stage.seen.decisions]
    stage.expect("GoalsPending" in reasons, "the reason is said")
    stage.traits(CLOUD).rejects -= 1
    stage.until(lambda: stage.holder is CLOUD, 20.0, "the cloud takes over")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)


def pin_does_not_wait_for_ever() -> None:
    """A pin changes over at the deadline although the goal is not accepted; it is offered there (section 8, rule 3)."""
    stage = GoalStage()
    stage.on_robot()
    goal = stage.goal()
    stage.traits(CLOUD).rejects += 1
    stage.pin(CLOUD)
    stage.until(lambda: stage.holder is CLOUD, 8.0, "the cloud holds")
    stage.run(0.3)
    stage.traits(CLOUD).rejects -= 1
    stage.until(lambda: bool(stage.copies(CLOUD, goal)), 1.0, "the goal is offered again")


def goal_after_a_loss() -> None:
    """After a loss the robot gets the goal as soon as it can; the cloud's copies end by themselves (rules 3, 4)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    stage.lose_cloud()
    stage.until(lambda: bool(stage.copies(ROBOT, goal)), 1.0, "the robot executes the goal")
    stage.until(lambda: not stage.copies(CLOUD, goal), 1.6, "the cloud's relay cancels what nobody named")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)


def goal_that_ends_in_the_change() -> None:
    """The old side's end that comes after the change counts only if it succeeded under its lease (rule 6)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    wire = stage.link.data.down
    wire.extra_s = 0.4
    stage.traits(CLOUD).takes_s = 0.0
    stage.run(0.03)
    stage.to(ROBOT)
    wire.extra_s = 0.0
    stage.ends(goal, SUCCEEDED)


def abort_when_deactivated() -> None:
    """The old side's nodes abort what they execute when they are deactivated: that never counts (rule 4)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    stage.traits(CLOUD).deaf += 1
    stage.to(ROBOT)
    stage.until(lambda: not stage.active("cloud"), 4.0, "the cloud's nodes rest")
    stage.run(0.5)
    stage.expect(goal.open, "the goal goes on")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)


def nodes_rest_after_their_goals() -> None:
    """The robot's nodes are deactivated only after their copies have ended, at most `cancelDeadline` later (rule 3)."""
    stage = GoalStage()
    stage.on_robot()
    goal = stage.goal()
    stage.traits(ROBOT).deaf += 1
    stage.pin(CLOUD)
    stage.until(lambda: stage.holder is CLOUD, 8.0, "the cloud holds")
    stage.always(lambda: stage.active("robot"), 1.5, "the robot's nodes stay Active while their copy runs")
    stage.until(lambda: not stage.active("robot"), 1.5, "and no longer than cancelDeadline")
    stage.run(0.5)
    stage.expect(goal.open, "the goal goes on")


def cancel_in_a_change() -> None:
    """A cancel is answered at once, and wins over the change (rule 7)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    for site in Site:
        stage.traits(site).deaf += 1
    stage.traits(ROBOT).accept_s = 1.0
    stage.by_hand(ROBOT)
    stage.run(0.5)
    stage.clients.cancel(FOLLOW, goal)
    stage.until(lambda: goal.cancel, 0.05, "the cancel is answered")
    stage.ends(goal, CANCELED, 8.0)
    stage.run(1.5)
    stage.expect(not [e for e in stage.copies(ROBOT, goal) if e.asked_s is None], "the late copy is cancelled too")


def goals_that_must_not_be_repeated() -> None:
    """`onSwitch: Abort` ends with the reason, and is never executed on the other side."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal(SPIN)
    stage.to(ROBOT)
    stage.ends(goal, ABORTED)
    stage.run(1.0)
    stage.expect(stage.began(ROBOT, goal) == 0, "the robot never began it")


def change_waits_for_hold() -> None:
    """`onSwitch: Hold`: a change by the policy waits for the goal's end, a switch by hand does not."""
    stage = GoalStage()
    stage.on_robot()
    goal = stage.goal(DOCK)
    stage.pin(None)
    stage.always(lambda: stage.holder is ROBOT, 2.0, "the change waits")
    stage.let_end(DOCK)
    stage.ends(goal, SUCCEEDED)
    stage.until(lambda: stage.holder is CLOUD, 8.0, "the change follows")
    for site in Site:
        stage.traits(site, DOCK).takes_s = float("inf")
    late = stage.goal(DOCK)
    stage.to(ROBOT)
    stage.ends(late, ABORTED)


def planned_switch_costs_no_goal() -> None:
    """`onSwitch: ResendOnLoss`: a planned switch waits for the goal's end, after a loss the robot has the goal."""
    follow = replace(RELAY.actions[0], on_switch=OnSwitch.RESEND_ON_LOSS)
    stage = GoalStage(relay=replace(RELAY, actions=(follow, *RELAY.actions[1:])))
    stage.on_robot()
    goal = stage.goal()
    stage.pin(None)
    stage.always(lambda: stage.holder is ROBOT, 20.0, "the switch waits without limit")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)
    stage.until(lambda: stage.holder is CLOUD, 8.0, "the switch follows")
    for site in Site:
        stage.traits(site).takes_s = float("inf")
    late = stage.goal()
    stage.lose_cloud()
    stage.until(lambda: bool(stage.copies(ROBOT, late)), 3.0, "the robot has the goal")
    stage.let_end()
    stage.ends(late, SUCCEEDED)


def long_goal_between_short_outages() -> None:
    """A `Resend` goal that outages made begin anew keeps the robot: no switch makes it begin anew for ever."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    for _ in range(2):
        join = stage.lose_cloud()
        stage.run(1.0)
        join()
        stage.run(12.0)
    began = stage.began(ROBOT, goal) + stage.began(CLOUD, goal)
    stage.always(lambda: stage.holder is ROBOT, 20.0, "the goal keeps its side")
    stage.expect(began == stage.began(ROBOT, goal) + stage.began(CLOUD, goal), "it does not begin anew")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)
    stage.until(lambda: stage.holder is CLOUD, 40.0, "the cloud is used again")


def goal_that_names_a_place() -> None:
    """A `Continue` goal moves at each change, however often: it never keeps the robot from being offloaded."""
    drive = replace(RELAY.actions[0], on_switch=OnSwitch.CONTINUE)
    stage = GoalStage(relay=replace(RELAY, actions=(drive, *RELAY.actions[1:])))
    stage.in_cloud()
    goal = stage.goal()
    for _ in range(3):
        join = stage.lose_cloud()
        stage.run(1.0)
        join()
        stage.until(lambda: stage.holder is CLOUD, 40.0, "the cloud is used again")
        stage.until(lambda: bool(stage.copies(CLOUD, goal)), 3.0, "the cloud has the goal")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)


def one_goal_at_a_time() -> None:
    """Servers with one goal preempt: the older goal ends once, the newer goes on over changes (rule 2)."""
    stage = GoalStage()
    stage.in_cloud()
    for site in Site:
        stage.traits(site).single = True
    first = stage.goal()
    second = stage.clients.send(FOLLOW)
    stage.ends(first, ABORTED)
    stage.until(lambda: bool(stage.copies(CLOUD, second)), 1.0, "the second goal is executed")
    for _ in range(3):
        stage.to(ROBOT)
        stage.expect(len(stage.copies(ROBOT, second)) == 1, "it goes on")
        stage.to(CLOUD)
    stage.expect(stage.began(ROBOT, first) == 0, "the older goal is not executed again")
    stage.let_end()
    stage.ends(second, SUCCEEDED)


def preempted_copies() -> None:
    """Where only the candidate takes one goal at a time, a copy that a later goal preempted is not offered again."""
    stage = GoalStage()
    stage.in_cloud()
    first, second = stage.goal(), stage.goal()
    stage.traits(ROBOT).single = True
    stage.traits(ROBOT).accept_s = 0.05
    stage.hush("robot")
    stage.by_hand(ROBOT)
    stage.run(3.0)
    stage.expect(stage.began(ROBOT, first) == 1, "the first goal was offered once")
    stage.expect(stage.began(ROBOT, second) == 1, "the second as well, and is not preempted by the first")
    stage.expect(first.open and second.open, "nothing of that reached the clients")


def copy_ends_first() -> None:
    """A candidate's copy that ends before the change does not count; the goal is offered again (rule 2)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    stage.traits(ROBOT).takes_s = 0.05
    stage.hush("robot")
    stage.by_hand(ROBOT)
    stage.until(lambda: stage.began(ROBOT, goal) >= 2, 3.0, "the copy is offered again")
    stage.expect(goal.open, "its end did not reach the client")


def forgotten_goal() -> None:
    """A server that was started again has forgotten the goal: it is offered again, an `Abort` goal ends (rule 10)."""
    stage = GoalStage()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(0.5)
    goal, spin = stage.goal(), stage.goal(SPIN)
    stage.robot.nodes["controller"].kill(0.3)
    stage.ends(spin, ABORTED, 3.0)
    stage.until(lambda: bool(stage.copies(ROBOT, goal)), 6.0, "the goal is executed again")


def no_answer_to_an_offer() -> None:
    """A server that does not answer an offer: ABORTED after `timeout` (rule 12)."""
    stage = GoalStage()
    stage.in_cloud()
    stage.traits(CLOUD).mute += 1
    goal = stage.clients.send(FOLLOW)
    stage.ends(goal, ABORTED, 2.5)


def late_acceptance() -> None:
    """An acceptance that comes after the offer was given up: the attempt is cancelled (rule 12)."""
    stage = GoalStage()
    stage.in_cloud()
    stage.traits(CLOUD).accept_s = 2.5
    goal = stage.clients.send(FOLLOW)
    stage.ends(goal, ABORTED, 2.5)
    stage.run(1.0)
    stage.expect(not stage.copies(CLOUD, goal), "what was accepted late does not run on")


def robots_relay_dies() -> None:
    """The successor goes on with the goals and answers its predecessor's clients, wherever they run (section 7)."""
    stage = GoalStage()
    stage.in_cloud()
    goals = [stage.goal() for _ in range(3)]
    stage.handing.robot.kill(0.3)
    stage.run(1.0)
    stage.expect(all(stage.began(CLOUD, goal) == 1 for goal in goals), "nothing began anew")
    stage.to(ROBOT)
    stage.handing.robot.kill(0.3)
    stage.run(0.1)
    stage.let_end()
    for goal in goals:
        stage.ends(goal, SUCCEEDED)


def change_without_a_relay() -> None:
    """The robot's relay is down while the holder changes: the stay in the journal is another one."""
    stage = GoalStage()
    stage.in_cloud()
    goal, spin = stage.goal(), stage.goal(SPIN)
    stage.handing.robot.kill(0.6)
    stage.run(0.05)
    stage.lose_cloud()
    stage.ends(spin, ABORTED)
    stage.until(lambda: bool(stage.copies(ROBOT, goal)), 3.0, "the robot executes the goal")
    stage.expect(goal.open, "it goes on")


def clouds_relay_dies() -> None:
    """A new relay in the cloud takes up what its server executes."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    stage.handing.cloud.kill(0.3)
    stage.run(1.5)
    stage.expect(stage.began(CLOUD, goal) == 1, "nothing began anew")
    heard = len(goal.fed)
    stage.run(0.3)
    stage.expect(len(goal.fed) > heard, "feedback passes again")
    stage.let_end()
    stage.ends(goal, SUCCEEDED)


def goal_between_arming_and_flip() -> None:
    """A new goal while a side gets ready goes to both; after the change it goes on (rule 2)."""
    stage = GoalStage()
    stage.in_cloud()
    stage.hush("robot")
    stage.by_hand(ROBOT)
    stage.until(lambda: stage.armed, 3.0, "the gate is armed")
    goal = stage.goal()
    stage.until(lambda: len(stage.copies(ROBOT, goal)) == 1, 0.5, "the candidate has it too")
    stage.robot.nodes["controller"].hung = 0
    stage.until(lambda: stage.holder is ROBOT, 2.0, "the robot holds")
    stage.run(0.3)
    stage.expect(stage.began(ROBOT, goal) == 1, "its copy went on")


def lost_letters() -> None:
    """Letters are written again: nothing is lost, nothing happens twice on a link that loses, doubles and reorders."""
    stage = GoalStage()
    stage.in_cloud()
    stage.pin(CLOUD)
    for wire in (stage.link.data.up, stage.link.data.down):
        wire.ordered = False
        wire.losses.append(0.2)
        wire.doubled = 0.3
        wire.reordering += 1
    goals = [stage.goal() for _ in range(10)]
    stage.let_end()
    for goal in goals:
        stage.ends(goal, SUCCEEDED, 8.0)


def late_report_of_the_collector() -> None:
    """Control hears of the change 100 ms late: the relay reads the collector's memory, feedback is the holder's."""
    stage = GoalStage(report_s=0.1)
    stage.in_cloud()
    goal = stage.goal()
    for _ in range(3):
        stage.to(ROBOT)
        stage.run(0.3)
        stage.to(CLOUD)
        stage.run(0.3)
    stage.expect(goal.open, "the goal goes on")


def many_goals_at_once() -> None:
    """Three actions' goals at once over changes, sent and cancelled all the time."""
    stage = GoalStage(relay=replace(RELAY, cancel_deadline_s=1.0))
    stage.in_cloud()
    goals = [stage.clients.send(FOLLOW) for _ in range(12)]
    stage.run(0.3)
    stage.by_hand(ROBOT)
    stage.clients.cancel(FOLLOW)
    goals += [stage.clients.send(FOLLOW) for _ in range(4)]
    stage.until(lambda: stage.holder is ROBOT, 8.0, "the robot holds")
    stage.run(1.0)
    stage.let_end()
    stage.until(lambda: all(goal.results for goal in goals), 8.0, "each goal has a result")
    stage.clients.finish(0.5)


def cancelled_by_somebody_else() -> None:
    """Another client cancels at the server itself: the goal's own client, who did not, gets ABORTED (invariant 6e)."""
    stage = GoalStage()
    stage.in_cloud()
    goal = stage.goal()
    stage.run(2.5)
    copy = stage.copies(CLOUD, goal)[0]
    stage.handing.servers[CLOUD].cancel(stage.handing.cloud, FOLLOW, copy.attempt, lambda _code: None)
    stage.ends(goal, ABORTED)


STORIES = (
    goal_over_twenty_changes, copy_before_the_change, goal_that_the_candidate_rejects, pin_does_not_wait_for_ever,
    goal_after_a_loss, goal_that_ends_in_the_change, abort_when_deactivated, nodes_rest_after_their_goals,
    cancel_in_a_change, goals_that_must_not_be_repeated, change_waits_for_hold, planned_switch_costs_no_goal,
    long_goal_between_short_outages, goal_that_names_a_place, one_goal_at_a_time, preempted_copies,
    copy_ends_first, forgotten_goal, no_answer_to_an_offer, late_acceptance, robots_relay_dies,
    change_without_a_relay, clouds_relay_dies, goal_between_arming_and_flip, lost_letters,
    late_report_of_the_collector, many_goals_at_once, cancelled_by_somebody_else,
)  # fmt: skip
