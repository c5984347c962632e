"""Stories of the inhibited driver: messages that were seen lift an inhibit, and no grace for whichever process does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robot_offload_core.control.robot.placement import CloudLeaving, Veto, Vetoed
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import OutputSpec
from robot_offload_sim.stories.nodes import FOREVER_S, TWO
from robot_offload_sim.stories.stage import Stage
from robot_offload_sim.world.scenario import Replica

Fall = Callable[[Stage], None]
"""Lets a process of the robot stand still or die for a second."""


def _hang(stage: Stage) -> None:
    stage.stall(stage.robot.collector, 1.0)


def _die(stage: Stage) -> None:
    stage.robot.collector.kill(1.0)


def _silent_behind(fall: Fall, *, in_cloud: bool = False, hot: bool = False) -> Stage:
    """Return a stage on which the driver is inhibited, and the arm fell silent before the collector is back."""
    stage = Stage(**TWO, hot=hot)
    if in_cloud:
        stage.in_cloud()
    else:
        stage.start(cloud=False)
        stage.robot_acts()
        stage.run(1.5)
    fall(stage)
    stage.until_inhibited(0.9, "without a collector the driver is inhibited")
    stage.hush("robot", "arm")
    return stage


def _released_by_messages(stage: Stage, for_s: float) -> None:
    """The driver stays inhibited while the arm is silent, and is released when the arm publishes again."""
    stage.always(lambda: stage.driver.inhibited, for_s, "an inhibit is lifted although an output is silent")
    stage.robot.nodes["arm"].hung -= 1
    stage.until(lambda: not stage.driver.inhibited, 1.0, "messages release the driver")


def released_by_messages() -> None:
    """A collector that hung or died comes back: the driver stays inhibited until messages of each output were seen."""
    for fall in (_hang, _die):
        _released_by_messages(_silent_behind(fall), 2.0)


def released_by_messages_after_a_loss() -> None:
    """The same when the cloud was in charge: the collector's late news of the robot's charge is no message."""
    for fall in (_hang, _die):
        stage = _silent_behind(fall, in_cloud=True)
        stage.cut()
        _released_by_messages(stage, 2.0)


def held_back_is_not_heard() -> None:
    """What a Hot robot publishes while the collector still passes the cloud moves nothing and releases no driver."""
    stage = Stage(hot=True)
    stage.in_cloud()
    start_s = stage.now
    stage.deaf("control", "collector", 0.2)
    control = stage.robot.control
    control.step(Vetoed("story", (Veto(Reason.TYPES_DIFFER, "the types differ", stops=True),)))
    stage.until_inhibited(0.05, "a strict veto stops the driver")
    stage.expect(stage.site is Site.ROBOT, "the robot is in charge")
    control.step(Vetoed("story"))
    passes = "released before a message of the robot passed"
    stage.always(lambda: stage.driver.inhibited or stage.first_message(start_s, Site.ROBOT) is not None, 0.15, passes)
    stage.until(lambda: not stage.driver.inhibited, 1.0, "messages release the driver")


def overtaken_words() -> None:
    """A driver that serves the later of two contrary requests first is brought to the last word at once."""
    for last in (True, False):
        _overtaken(last)


def _overtaken(last: bool) -> None:
    stage = Stage()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.0)
    if last:
        _stop(stage, True)
        stage.until_inhibited(0.05, "a strict veto stops the driver")
    stage.driver.slow_s = 0.02
    _stop(stage, not last)
    stage.driver.slow_s = 0.0
    _stop(stage, last)
    stage.run(0.1)
    stage.always(lambda: stage.driver.inhibited is last, 0.3, "a request that was overtaken is the driver's last word")


def _stop(stage: Stage, stops: bool) -> None:
    vetoes = (Veto(Reason.TYPES_DIFFER, "the types differ", stops=True),) if stops else ()
    stage.robot.control.step(Vetoed("story", vetoes))


def no_release_by_old_reports() -> None:
    """What the collector reported before it hung lifts no inhibit while control stalls and judges no silence."""
    stage = _silent_behind(lambda s: s.stall(s.robot.collector, 5.0))
    for _ in range(5):
        stage.stall(stage.robot.control, 0.2)
        stage.always(lambda: stage.driver.inhibited, 0.6, "a stall of control's own lifts an inhibit")


def restarted_control_releases_by_messages() -> None:
    """A control that restarts releases a driver, inhibited by its earlier life, for messages and not for its grace."""
    stage = Stage(**TWO)
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.5)
    stage.hush("robot", "arm")
    stage.until_inhibited(0.9, "a silent output stops the driver")
    stage.robot.control.kill(0.1)
    _released_by_messages(stage, 2.0)


def slow_outputs_hold_nobody() -> None:
    """After an inhibit for nodes that woke late the fast outputs release the driver, slow ones have their deadline."""
    slow = TWO | {
        "outputs": (OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 12.0)),
        "replicas": {"controller": Replica(0, 0.05), "arm": Replica(1, 5.0, on_activate=True)},
    }
    stage = Stage(**slow)
    stage.start()
    stage.until(lambda: stage.phase is Phase.CLOUD, 30.0, "the cloud is in charge")
    stage.run(13.0)
    stage.robot.nodes["controller"].slow_s = 0.6
    stage.cut()
    stage.until_inhibited(1.0, "nodes that wake too late stop the driver")
    stage.until(lambda: not stage.driver.inhibited, 2.0, "a slow output holds the driver")


def _slow_arm(**changes: Any) -> Stage:
    """Return a stage whose arm publishes every 5 s from its activation on, and may be silent for 12 s."""
    slow: dict[str, Any] = TWO | {
        "outputs": (OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 12.0)),
        "replicas": {"controller": Replica(0, 0.05), "arm": Replica(1, 5.0, on_activate=True)},
    }
    return Stage(**slow | changes)


def _arm_is_dead(stage: Stage) -> None:
    """Let the arm's node be dead for longer than its output may be silent."""
    stage.robot.nodes["arm"].kill(26.0)
    stage.until(lambda: stage.driver.inhibited, 16.0, "a dead CORE node stops the driver")
    stage.until(lambda: stage.robot.nodes["arm"].alive, 26.0, "it returns")


def need_waits_for_no_slow_output() -> None:
    """A robot that cannot act has the cloud in charge as soon as the fast outputs flow there."""
    stage = _slow_arm()
    stage.start()
    stage.robot_acts()
    stage.pin(Site.ROBOT)
    stage.run(14.0)
    stage.expect(stage.phase is Phase.ROBOT, "the robot is in charge")
    stage.pin(None)
    stage.robot.nodes["controller"].kill(FOREVER_S)
    stage.until(lambda: stage.phase is Phase.CLOUD, 4.0, "the cloud acts for a robot that cannot")
    stage.until(lambda: not stage.driver.inhibited, 1.0, "the driver follows it")
    stage.always(lambda: stage.phase is Phase.CLOUD, 13.0, "the slow output speaks in time there")


def veto_waits_for_no_slow_output() -> None:
    """A cloud that stops is left as soon as the robot's fast outputs flow, whatever the change was begun for."""
    for pinned in (False, True):
        stage = _slow_arm()
        stage.start()
        stage.until(lambda on=stage: on.phase is Phase.CLOUD, 30.0, "the cloud is in charge")  # type: ignore[misc]
        stage.run(7.0)
        if pinned:
            stage.pin(Site.ROBOT)
            stage.run(1.5)
            stage.expect(stage.phase is Phase.TO_ROBOT, "a pin waits for the slow output")
        stage.robot.control.step(CloudLeaving(stage.machine.link.peer, stage.robot.host.now_s() + 30.0))
        stage.until(lambda on=stage: on.phase is Phase.ROBOT, 1.5, "the robot takes over at once")  # type: ignore[misc]
        stage.always(lambda on=stage: not on.driver.inhibited, 13.0, "the slow output speaks in time")  # type: ignore[misc]


def returned_nodes_are_released_before_their_slow_output_speaks() -> None:
    """A node whose slow output fell silent while it was dead has its deadline again from its return."""
    stage = _slow_arm()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(14.0)
    _arm_is_dead(stage)
    stage.until(lambda: not stage.driver.inhibited, 3.0, "the slow output holds a driver whose nodes act again")
    stage.run(1.0)
    stage.hush("robot", "arm")
    stage.until(lambda: stage.driver.inhibited, 13.0, "a slow output that never speaks stops the driver")


def returning_again_earns_no_second_deadline() -> None:
    """A node that returns again and again without a message of its slow output does not let the robot go on."""
    stage = _slow_arm()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(14.0)
    for number in range(2):
        _arm_is_dead(stage)
        stage.hush("robot", "arm")
        if number == 0:
            stage.until(lambda: not stage.driver.inhibited, 3.0, "released at the first return")
            stage.until(lambda: stage.driver.inhibited, 13.0, "silent since")
    stage.always(lambda: stage.driver.inhibited, 4.0, "another return releases the driver")


def collector_that_returns_waits_for_no_slow_output() -> None:
    """The fast outputs release a driver that was stopped for the collector; the slow one was heard not long ago."""
    for fall in (_hang, _die):
        stage = _slow_arm()
        stage.start(cloud=False)
        stage.robot_acts()
        stage.run(20.2)
        fall(stage)
        stage.until_inhibited(0.9, "without a collector the driver is inhibited")
        driver = stage.driver
        stage.until(lambda on=driver: not on.inhibited, 2.0, "the slow output holds the driver")  # type: ignore[misc]


def driver_that_dies_inhibited() -> None:
    """A driver that dies while it is inhibited stands, which cannot be lifted, and comes back free."""
    stage = Stage()
    stage.in_cloud()
    stage.driver.inhibited = True
    stage.driver.kill(0.8)
    stage.run(1.0)
    stage.expect(not stage.driver.inhibited, "the cloud is in charge, and the driver is free")


STORIES = (
    driver_that_dies_inhibited,
    released_by_messages,
    released_by_messages_after_a_loss,
    held_back_is_not_heard,
    overtaken_words,
    no_release_by_old_reports,
    restarted_control_releases_by_messages,
    slow_outputs_hold_nobody,
    need_waits_for_no_slow_output,
    veto_waits_for_no_slow_output,
    returned_nodes_are_released_before_their_slow_output_speaks,
    returning_again_earns_no_second_deadline,
    collector_that_returns_waits_for_no_slow_output,
)
