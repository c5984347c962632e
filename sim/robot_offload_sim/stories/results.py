"""Stories of nodes with placement Cloud: their results reach the robot whoever is in charge, young or not at all."""

from __future__ import annotations

from dataclasses import replace

from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import NodeSpec, OutputSpec
from robot_offload_sim.stories.stage import CONTROLLER, PLANNER, Stage, StoryError
from robot_offload_sim.world.scenario import Replica

DETECTOR = NodeSpec("detector", duplicated=False)
DETECTIONS = OutputSpec("detections", 0.3, 0.1, of_cloud=True, nodes=("detector",))
RESULTS = 1


def _stage(*, drops: bool = True, **changes: object) -> Stage:
    output = replace(DETECTIONS, **changes)  # type: ignore[arg-type]
    return Stage(
        drops=drops, outputs=(OutputSpec("cmd_vel", 0.15), output), cloud_only=(DETECTOR,),
        replicas={"controller": Replica(0, 0.05), "detector": Replica(RESULTS, 0.1)},
    )  # fmt: skip


def _flow(stage: Stage, for_s: float, what: str) -> None:
    """Raise StoryError unless results arrive without a gap for a while."""
    from_s = stage.now
    stage.run(for_s)
    gap_s = stage.longest_gap(from_s, RESULTS)
    stage.expect(gap_s < 0.2, f"{what}: {gap_s * 1e3:.0f} ms without a result")


def _stated(stage: Stage) -> Reason | None:
    """Return the reason in the newest statement on the detector."""
    if not stage.seen.statements:
        raise StoryError("nothing was stated of the detector")
    return stage.seen.statements[-1][1].reason


def _until_stated(stage: Stage, *, available: bool) -> None:
    """Wait until the detector is stated to be available, or not."""
    words = "available" if available else "away"
    stage.until(lambda: (_stated(stage) is None) is available, 3.0, f"the detector is stated to be {words}")


def results_whoever_is_in_charge() -> None:
    """Results arrive while the cloud acts, through changeovers, and while the robot acts; a cut silences them."""
    stage = _stage()
    stage.in_cloud()
    _flow(stage, 1.0, "in the cloud")
    stage.pin(Site.ROBOT)
    _flow(stage, 3.0, "through a changeover and on the robot")
    stage.expect(stage.phase is Phase.ROBOT, "pinned to the robot")
    stage.expect(_stated(stage) is None, "the detector is stated to be available")
    stage.pin(Site.CLOUD)
    _flow(stage, 3.0, "back")


def results_through_a_cut() -> None:
    """A cut is stated with its reason, no result is older than its age, and results come back with the link."""
    for way in ("both", "down", "up"):
        stage = _stage(max_age_s=0.1)
        stage.in_cloud()
        cut_s = stage.now
        join = stage.cut(way)
        _until_stated(stage, available=False)
        stage.run(2.0)
        late = [m for m in stage.seen.messages if m.index == RESULTS and m.at_s > cut_s + 0.15]
        stage.expect(not late, f"{len(late)} results during the cut")
        join()
        _until_stated(stage, available=True)
        _flow(stage, 1.0, "after the cut")


def results_of_a_slow_link() -> None:
    """Results that are older than their age are left out, and that is stated; a longer age lets them pass."""
    stage = _stage(max_age_s=0.02)
    stage.in_cloud()
    stage.link.data.down.extra_s += 0.025
    stage.until(lambda: _stated(stage) is Reason.RESULT_STALE, 2.0, "results that are too old are stated")


def results_of_a_restarted_agent() -> None:
    """Whatever process of either agent dies, results flow again, and none of an earlier life passes."""
    stage = _stage()
    stage.in_cloud()
    stage.run(4.0)
    robot, cloud = stage.robot, stage.cloud
    for process in (cloud.data, robot.data, robot.collector, cloud.control, robot.control):
        process.kill(0.3)
        stage.run(2.0)
        _flow(stage, 1.0, process.name)


def results_of_a_robot_that_stopped_vouching() -> None:
    """A robot whose control is stopped grants presence to no cloud: what left the cloud later reaches no consumer."""
    stage = _stage(max_age_s=10.0)
    stage.in_cloud()
    stage.pin(Site.ROBOT)
    stage.run(2.0)
    stage.stall(stage.robot.control, 2.0)
    stage.run(1.0)
    silent_s = stage.now - max(m.at_s for m in stage.seen.messages if m.index == RESULTS)
    stage.expect(silent_s > 0.5, "a stopped control lets nothing pass")
    stage.run(3.0)
    _flow(stage, 1.0, "control is back")


def results_that_come_twice() -> None:
    """A result that the link repeats passes once, also when the collector is another one meanwhile."""
    stage = _stage(max_age_s=3.0)
    stage.in_cloud()
    stage.link.data.down.doubled = 0.9
    stage.run(2.0)
    for _ in range(12):
        stage.robot.collector.kill(0.05)
        stage.run(1.0)
    stage.expect(len([m for m in stage.seen.messages if m.index == RESULTS]) > 50, "results flow")


def results_of_two_robots_lives() -> None:
    """What left for an earlier life of the robot's control passes in no later one, however young."""
    stage = _stage(drops=False, max_age_s=3.0)
    stage.in_cloud()
    stage.link.data.down.extra_s = 0.8
    stage.run(1.0)
    stage.robot.control.kill(0.1)
    stage.run(4.0)
    stage.link.data.down.extra_s = 0.0
    stage.run(2.0)
    _flow(stage, 1.0, "the new life of control")


def results_after_old_grants() -> None:
    """Grants that waited in a buffer let no result leave."""
    stage = _stage()
    stage.in_cloud()
    for number in range(6):
        stage.link.pulse.up.cut_held += 1
        stage.run(1.5 + 0.017 * number)
        stage.link.pulse.up.cut_held -= 1
        stage.link.pulse.up.release()
        stage.run(1.0)


def results_of_a_dead_node() -> None:
    """A detector that died or hangs is stated; it causes no switch, and does not stop the wheels."""
    stage = _stage()
    stage.in_cloud()
    epoch = stage.machine.epoch
    stage.hush("cloud", "detector")
    stage.until(lambda: _stated(stage) is Reason.OUTPUT_SILENT, 1.0, "a silent detector is stated")
    stage.cloud.nodes["detector"].kill(1e9)
    stage.until(lambda: _stated(stage) is Reason.CLOUD_NODES_DOWN, 6.0, "a dead detector is stated")
    stage.always(lambda: not stage.driver.inhibited and stage.machine.epoch == epoch, 3.0, "nobody switches for it")


def results_alone() -> None:
    """A robot without duplicated outputs gets results; nothing waits for them at a changeover."""
    stage = Stage(
        nodes=(replace(PLANNER, core=True), replace(CONTROLLER, core=False)), outputs=(DETECTIONS,),
        mirrored=(), cloud_only=(DETECTOR,), replicas={"detector": Replica(0, 0.1)},
    )  # fmt: skip
    stage.in_cloud()
    from_s = stage.now
    stage.pin(Site.ROBOT)
    stage.until_phase(Phase.ROBOT, 2.0, "pinned to the robot")
    stage.run(1.0)
    stage.expect(stage.longest_gap(from_s, 0) < 0.2, "results flow")


STORIES = (
    results_whoever_is_in_charge,
    results_through_a_cut,
    results_of_a_slow_link,
    results_of_a_restarted_agent,
    results_of_a_robot_that_stopped_vouching,
    results_that_come_twice,
    results_of_two_robots_lives,
    results_after_old_grants,
    results_of_a_dead_node,
    results_alone,
)
