"""Stories of Hot standby: the newest message is at hand, and a missing one of the cloud is a loss at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

from robot_offload_core.collector import lateness
from robot_offload_core.control.robot import fast_takeover
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import NodeSpec, OutputSpec, Settings
from robot_offload_sim.stories.stage import Stage, StoryError
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.scenario import Replica

JUDGED_S = 0.05
"""Less than the time in which a takeover is judged."""
LEARNED_S = 6.0
"""Time in which the margin is learned: a hundred messages."""
PERIOD_S = 0.05
BOTH = (Site.ROBOT, Site.CLOUD)
HOT = NodeSpec("controller", core=True, hot=True)
COMMANDS = OutputSpec("cmd_vel", 0.15, PERIOD_S, nodes=("controller",), hot=BOTH)


def _stage(cloud_s: float = PERIOD_S, **changes: Any) -> Stage:
    settings = Settings(
        cloud_period_s=cloud_s, tolerance_s=PERIOD_S, hold_down_initial_s=1.0, flap_window_s=3.0, hold_down_max_s=4.0
    )
    small = {"nodes": (HOT,), "outputs": (COMMANDS,), "replicas": {"controller": Replica(0, PERIOD_S)}}
    stage = Stage(settings=settings, **(small | changes))
    stage.in_cloud()
    return stage


def _every(period_s: float) -> dict[str, Any]:
    """Return the arguments that make both replicas publish at a rate."""
    return {"outputs": (replace(COMMANDS, period_s=period_s),), "replicas": {"controller": Replica(0, period_s)}}


def _learned(stage: Stage) -> Stage:
    stage.run(LEARNED_S)
    late = stage.robot.collector.state.outputs[0].late
    stage.expect(late.seen == lateness.TAUGHT, "a hundred messages were heard")
    return stage


def _gap(stage: Stage, from_s: float) -> float:
    """Return the silence at the consumer between its last message of the cloud and the next of the robot."""
    at_s = stage.first_message(from_s, Site.ROBOT)
    assert at_s is not None
    return at_s - max(m.at_s for m in stage.seen.messages if m.site is Site.CLOUD and m.at_s < at_s)


def hot_robot_takes_over_by_silence() -> None:
    """A cut is noticed by the first message that does not come; the robot's newest one passes at once."""
    for cloud_s in (0.02, PERIOD_S):
        stage = _learned(_stage(cloud_s))
        cut_s = stage.now
        stage.cut()
        stage.lost(0.09, "less than the loss timeout: by silence")
        stage.expect(stage.machine.decided.reason is Reason.OUTPUT_SILENT, "it says which silence")
        stage.expect(stage.machine.early.taken_s is not None, "to be judged")
        stage.until_heard(cut_s, Site.ROBOT, 0.005, "the newest message of the robot passes")
        gap_s = _gap(stage, cut_s)
        stage.expect(gap_s < PERIOD_S + 0.025, f"{gap_s * 1e3:.0f} ms without a command")
        stage.until(lambda: stage.machine.early.taken_s is None, 0.2, "the heartbeats confirm the loss")  # noqa: B023
        stage.expect(stage.machine.early.mistakes_s == (), "it was no mistake")
        stage.expect(stage.machine.policy.entered_s is None, "and the policy learns of it as of every loss")


def hot_robot_before_it_has_learned() -> None:
    """Before a hundred messages were heard the loss timeout is waited for."""
    for number in range(3):
        stage = _stage()
        stage.run(0.017 * number)  # at some moment between two messages
        stage.cut()
        # The last beat may have come a beat period before the cut, and the loss timeout counts from there.
        stage.always(lambda s=stage: s.phase is Phase.CLOUD, 0.06, "no takeover by one missing message")  # type: ignore[misc]
        stage.until_phase(Phase.ROBOT, 0.1, "the loss is noticed as always")


def both_silent_prove_nothing() -> None:
    """When the robot's Hot replica is silent as well there may be nothing to do: no takeover by silence."""
    stage = _learned(_stage())
    stage.hush("robot")
    stage.run(0.1)
    stage.hush("cloud")
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.09, "silence of both is judged by the deadline alone")
    stage.until_phase(Phase.ROBOT, 0.3, "which ends the stay")


def _pause_of_the_cloud(stage: Stage, for_s: float) -> None:
    """Let the data wire hold everything back for a while."""
    wire, heard = stage.link.data.down, len(stage.seen.messages)
    stage.until(lambda: len(stage.seen.messages) > heard, 0.1, "a message just came")
    wire.cut_held += 1
    stage.run(for_s)
    wire.cut_held -= 1
    wire.release()


def late_message_after_a_takeover() -> None:
    """A message that comes after it was taken for lost sets a floor: the next one as late is waited for."""
    stage = _learned(_stage())
    stage.by_hand(Site.CLOUD)
    session = stage.link.data.life
    _pause_of_the_cloud(stage, 0.09)
    stage.expect(stage.site is Site.ROBOT, "taken for lost")
    stage.expect(stage.link.data.life == session, "the sessions stay open")
    stage.run(0.2)
    stage.expect(len(stage.machine.early.mistakes_s) == 1, "no limit broke: a mistake")
    stage.expect(stage.machine.manual is not None, "the wish by hand stays")
    stage.until_phase(Phase.CLOUD, 1.0, "and the cloud is used again, without a hold-down")
    stage.run(1.0)
    known = stage.robot.collector.state.outputs[0].late
    stage.expect(known.floor_s > 0.03, f"the margin has a floor, {known.floor_s * 1e3:.0f} ms")
    _forget_mistakes(stage)
    stage.run(lateness.LATENESS_WINDOW_S)
    _pause_of_the_cloud(stage, 0.085)
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.1, "as late a message is waited for, minutes later too")


def _forget_mistakes(stage: Stage) -> None:
    """Take back what control has learned from its mistakes, as if an hour had passed."""
    control = stage.robot.control.process
    control.robot = replace(control.robot, early=replace(control.robot.early, floors=()))


def _lose(stage: Stage, for_s: float) -> None:
    """Lose everything that the cloud sends within a time that begins just after a message."""
    wire, heard = stage.link.data.down, len(stage.seen.messages)
    stage.until(lambda: len(stage.seen.messages) > heard, 0.1, "a message just came")
    wire.losses.append(1.0)
    stage.run(for_s)
    wire.losses.remove(1.0)


def lost_message_that_is_not_sent_again() -> None:
    """Where nothing lost is sent again, the gap that a lost message leaves teaches how late the next may be."""
    stage = _learned(_stage(0.029, best_effort=(0,), jitter_s=0.0))
    _lose(stage, PERIOD_S)
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.06, "a gap of two of the cloud's periods is 8 ms late")
    _pause_of_the_cloud(stage, 0.056)
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.06, "half as much again is waited for")


def mistake_teaches_whoever_hears_nothing_more() -> None:
    """After a mistake its output is waited for a period longer, for an hour, whatever the collector has heard."""
    stage = _learned(_stage(best_effort=(0,), jitter_s=0.0))
    _mistake(stage)
    _lose(stage, PERIOD_S)
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.2, "the same again is no loss")
    floors = tuple(
        replace(floor, until_s=floor.until_s - fast_takeover.FLOOR_S) for floor in stage.machine.early.floors
    )
    stage.robot.control.process.robot = replace(stage.machine, early=replace(stage.machine.early, floors=floors))
    stage.run(lateness.LATENESS_WINDOW_S)
    _mistake(stage)


def _mistake(stage: Stage) -> None:
    """Lose a message, and all that the cloud sends after the robot took that for the cloud's end."""
    _lose(stage, PERIOD_S)
    stage.until(lambda: stage.site is Site.ROBOT, 0.1, "taken for lost")
    wire = stage.link.data.down
    wire.losses.append(1.0)
    stage.run(0.1)
    wire.losses.remove(1.0)
    stage.until(lambda: stage.machine.early.taken_s is None, 0.3, "judged")
    stage.until_phase(Phase.CLOUD, 1.0, "a mistake: the cloud is used again, without a hold-down")
    stage.run(1.0)


def third_mistake_within_ten_minutes() -> None:
    """The third takeover by silence that no limit confirms starts the hold-down; then only limits end a stay.

    After a stay of a minute a missing message counts again.
    """
    stage = _learned(_stage())
    for mistakes in (1, 2, 3):
        stage.until_phase(Phase.CLOUD, 0.5, "in the cloud, without a hold-down")
        stage.run(0.5)
        collector = stage.robot.collector.process
        late = replace(collector.state.outputs[0].late, floor_s=0.0, late=())  # as if minutes had passed
        collector.state = replace(collector.state, outputs=(replace(collector.state.outputs[0], late=late),))
        _forget_mistakes(stage)
        stage.run(PERIOD_S)
        _pause_of_the_cloud(stage, 0.09)
        stage.until(lambda: stage.site is Site.ROBOT, 0.1, f"takeover {mistakes}")
        stage.run(0.25)
    stage.expect(stage.machine.early.off, "three are too many")
    hold_s = stage.machine.policy.hold_until_s - stage.robot.host.now_s()
    stage.expect(hold_s > 0.3, f"the hold-down has begun, {hold_s:.1f} s")
    stage.until_phase(Phase.CLOUD, 8.0, "back in the cloud")
    stage.run(1.0)
    _pause_of_the_cloud(stage, 0.095)
    stage.expect(stage.phase is Phase.CLOUD, "a late message ends no stay")
    stage.run(fast_takeover.PROVEN_S + 1)
    stage.expect(not stage.machine.early.off, "after a minute it would again")
    stage.expect(stage.machine.early.floors != (), "after a longer silence than the one that was a mistake")


def standstill_of_the_collector() -> None:
    """A collector that stood still reads what has come before it takes anything for lost."""
    stage = _learned(_stage())
    for for_s in (0.06, 0.1, 0.14):
        stage.stall(stage.robot.collector, for_s)
        stage.always(lambda: stage.phase is Phase.CLOUD, for_s + 0.2, "the cloud has spoken all the time")
        stage.run(1.0)


def warm_core_node_beside_a_hot_one() -> None:
    """A robot that must wake a CORE node first gains nothing by leaving early: only limits end a stay."""
    arm = NodeSpec("arm", core=True)
    stage = _learned(_stage(nodes=(HOT, arm)))
    stage.cut()
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.08, "one missing message ends no stay")
    stage.until_phase(Phase.ROBOT, 0.2, "the loss is noticed as always")


PLAN, MAP = 1, 2
SELDOM = (OutputSpec("plan", 0.0, hot=BOTH), OutputSpec("map", 0.0, hot=BOTH, latched=True))


def newest_messages_of_topics_that_speak_seldom() -> None:
    """At a changeover the new side's newest latched message passes whatever its age, an old one of others never."""
    stage = _stage(outputs=(COMMANDS, *SELDOM), mirrored=(0, MAP))
    stage.run(0.5)

    def publish(site: Site, index: int, sequence: int) -> float:
        message = Message(f"{site.value}{index}", 1, sequence, stage.now)
        if site is Site.ROBOT:
            stage.robot.collector.robot_message(index, message)
        else:
            stage.cloud.data.output(index, message, stage.cloud.host.system_s())
        return stage.now

    def heard(site: Site, index: int, born_s: float) -> int:
        return sum(m.site is site and m.index == index and m.born_s == born_s for m in stage.seen.messages)

    def change(site: Site) -> None:
        stage.pin(site)
        stage.until(lambda: stage.site is site, 1.0, "pinned")
        stage.run(0.5)

    old = {index: publish(Site.ROBOT, index, 1) for index in (PLAN, MAP)}
    stage.run(2.0)
    change(Site.ROBOT)
    stage.expect(heard(Site.ROBOT, MAP, old[MAP]) == 1, "the robot's map")
    stage.expect(heard(Site.ROBOT, PLAN, old[PLAN]) == 0, "no plan of long ago")
    born_s = publish(Site.CLOUD, MAP, 1)
    old_plan_s = publish(Site.CLOUD, PLAN, 1)
    stage.run(2.0)
    stage.expect(heard(Site.CLOUD, MAP, born_s) == 0, "the standby is not heard")
    change(Site.CLOUD)
    stage.expect(heard(Site.CLOUD, MAP, born_s) == 1, "the cloud's map, once")
    stage.expect(heard(Site.CLOUD, PLAN, old_plan_s) == 0, "no plan of long ago")
    stage.expect(any(m.site is Site.CLOUD and m.born_s == born_s for m in stage.seen.in_cloud), "in the cloud as well")
    change(Site.ROBOT)
    stage.expect(heard(Site.ROBOT, MAP, old[MAP]) == 2, "the robot's map again, because the cloud's was heard since")
    stage.pin(Site.CLOUD)
    stage.until(lambda: stage.armed, 1.0, "the cloud is ready")
    newer_s = publish(Site.ROBOT, PLAN, 2)
    stage.until(lambda: stage.site is Site.CLOUD, 1.0, "pinned")
    change(Site.ROBOT)
    stage.expect(heard(Site.ROBOT, PLAN, newer_s) == 1, "what has passed does not pass again")
    change(Site.CLOUD)
    recent_s = publish(Site.ROBOT, PLAN, 3)
    stage.run(0.02)
    stage.cut()
    stage.lost(0.3, "the link is cut")
    stage.run(0.1)
    stage.expect(heard(Site.ROBOT, PLAN, recent_s) == 1, "a recent plan passes")


def lossy_link() -> None:
    """At 40 +- 5 ms and 3 % loss next to no message is taken for lost that comes after all: two in an hour."""
    mistakes = hour_on_a_lossy_link(for_s=120.0)
    if mistakes > 2:
        raise StoryError(f"{mistakes} mistakes by silence in two minutes")


def lossy_link_that_repeats_nothing() -> None:
    """The same where nothing lost is sent again, for a cloud that is as fast as declared and for a faster one."""
    for cloud_s in (PERIOD_S, 0.02):
        mistakes = hour_on_a_lossy_link(cloud_s, best_effort=True, for_s=90.0)
        if mistakes > 2:
            raise StoryError(f"{mistakes} mistakes by silence in a minute and a half, one message in {cloud_s:g} s")


def hour_on_a_lossy_link(
    cloud_s: float = PERIOD_S, *, best_effort: bool = False, for_s: float = 3600.0, name: str = "story",
    loss: float = 0.03,
) -> int:  # fmt: skip
    """Return how many takeovers by silence, unconfirmed by a limit, an hour at 40 +- 5 ms has.

    Args:
        cloud_s: period of the cloud's replica, seconds; the declared one is 50 ms.
        best_effort: whether lost messages are not sent again.
        for_s: how long instead of an hour, seconds.
        name: seed of the run.
        loss: share of the packets that are lost, both ways.
    """
    stage = _stage(cloud_s, name=name, delay_s=0.018, jitter_s=0.002, best_effort=(0,) if best_effort else ())
    for session in (stage.link.data, stage.link.pulse):
        session.up.losses.append(loss)
        session.down.losses.append(loss)
    mistakes, end_s = 0, stage.now + for_s
    while stage.now < end_s:
        before = stage.machine.early
        stage.run(JUDGED_S)
        after = stage.machine.early
        judged = before.taken_s is not None and after.taken_s is None
        mistakes += judged and (after.off or after.mistakes_s != before.mistakes_s)
        stage.seen.messages.clear()
        stage.seen.left.clear()
    return mistakes


def commanded_change_between_hot_sides() -> None:
    """Between Hot sides a commanded change leaves no gap longer than a period and 3 ms, whatever the link's delay.

    A link's jitter is beside it: it tears such gaps into the cloud's own messages too, without any change.
    """
    for cloud_s, delay_s in ((PERIOD_S, 0.005), (PERIOD_S, 0.018), (0.02, 0.018)):
        stage = _learned(_stage(cloud_s, delay_s=delay_s, jitter_s=0.0, **_every(cloud_s)))
        stage.seen.messages.clear()
        stage.run(0.2)
        for site in BOTH * 10:
            stage.pin(site)
            stage.until(lambda wanted=site: stage.site is wanted, 0.5, "pinned")  # type: ignore[misc]  # noqa: B023
            stage.run(0.3)
        passed = list(pairwise(stage.seen.messages))
        changes = [
            (later.at_s - earlier.at_s, later.site) for earlier, later in passed if earlier.site is not later.site
        ]
        stage.expect(len(changes) == 20, "each change was felt")
        gap_s, site = max(changes)
        stage.expect(
            gap_s <= cloud_s + 0.003, f"{gap_s * 1e3:.1f} ms without a command at a change to the {site.value}"
        )


STORIES: tuple[Callable[[], None], ...] = (
    hot_robot_takes_over_by_silence, hot_robot_before_it_has_learned, both_silent_prove_nothing,
    warm_core_node_beside_a_hot_one, newest_messages_of_topics_that_speak_seldom,
    late_message_after_a_takeover, third_mistake_within_ten_minutes, standstill_of_the_collector,
    lost_message_that_is_not_sent_again, mistake_teaches_whoever_hears_nothing_more,
    lossy_link, lossy_link_that_repeats_nothing, commanded_change_between_hot_sides,
)  # fmt: skip
