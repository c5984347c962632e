"""Stories of words between processes that come late: gates and reports that waited in a queue."""

from __future__ import annotations

from robot_offload_core.control.nodes.managed_nodes import Observed
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.pulse.pulse import compose
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.gates import Gate, GateReport
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.messages import CollectorStatus, SetGate
from robot_offload_core.words.settings import Settings
from robot_offload_sim.stories.stage import Stage


def _gate_of_now(stage: Stage) -> SetGate:
    """Return the gate that control has set, as it may wait in a queue."""
    state = stage.robot.collector.state
    assert state.charge is not None
    return SetGate(Gate(state.started_us, state.charge, None, stage.robot.host.now_s()))


def old_gate_after_a_fallback() -> None:
    """A gate of an epoch that was left changes nothing after a fallback from the robot."""
    stage = Stage()
    stage.in_cloud()
    old = _gate_of_now(stage)
    stage.by_hand(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.ROBOT, 2.0, "the robot is in charge")
    collector = stage.robot.collector
    stage.stall(stage.robot.control, 2.0)
    stage.until(lambda: collector.state.fell_back, 1.0, "control's silence is noticed")
    before = collector.state.charge
    collector.take(old)
    stage.expect(collector.state.charge == before and collector.state.fell_back, "an old gate ends the fallback")


def old_gate_after_a_restart() -> None:
    """A gate of an epoch that was left changes nothing for a collector that has just taken up what it had reached."""
    stage = Stage()
    stage.in_cloud()
    old = _gate_of_now(stage)
    stage.by_hand(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.ROBOT, 2.0, "the robot is in charge")
    collector = stage.robot.collector
    before = collector.state.charge
    collector.kill(0.005)
    stage.until(lambda: collector.state.resumed_s is not None and collector.state.gate_s is None, 0.1, "it is back")
    collector.take(old)
    stage.expect(collector.state.charge == before, "a restarted collector goes back to an older epoch")


def new_control_while_the_cloud_is_next() -> None:
    """A control that restarts while the changeover is offered: nobody is next any more, and the robot goes on."""
    stage = Stage()
    stage.start()
    stage.robot_acts()
    stage.hush("cloud")
    stage.until(lambda: stage.robot.collector.state.next is not None, 8.0, "the changeover is offered")
    stage.robot.control.kill(0.01)
    stage.always(lambda: stage.robot.collector.state.charge is not None, 0.02, "somebody is in charge")
    stage.until(lambda: stage.robot.collector.state.next is None, 0.3, "the new control has named nobody as next")
    charge = stage.robot.collector.state.charge
    stage.expect(charge is not None and charge.site is Site.ROBOT, "the cloud got in charge of a new control")


def changed_over_just_before_it_was_called_off() -> None:
    """The collector's report of a changeover counts although control has called the preparation off meanwhile."""
    stage = Stage()
    stage.in_cloud()
    stage.hush("robot")
    stage.by_hand(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.TO_ROBOT, 0.5, "the robot gets ready")
    candidate = stage.machine.candidate
    stage.until(lambda: stage.phase is Phase.CLOUD, 3.0, "the preparation is called off")
    charge = Charge(Site.ROBOT, Token(stage.machine.incarnation, candidate, ""))
    stage.robot.control.take(CollectorStatus(GateReport(charge, False, True, False)))
    stage.expect(stage.site is Site.ROBOT and stage.machine.epoch == candidate, "the robot is in charge and not told")


def beat_behind_other_words() -> None:
    """A control that pauses too shortly for a stall reads the beat that waits before it judges silence, many times."""
    stage = Stage(settings=Settings(tolerance_s=0.1, lease_s=0.4, max_command_age_s=0.3))  # late is still good enough
    stage.in_cloud()
    for attempt in range(12):
        join = stage.cut("down", "pulse")
        stage.run(0.050)
        stage.stall(stage.robot.control, 0.044)
        stage.run(0.005)
        join()
        stage.always(lambda: stage.phase is Phase.CLOUD, 0.3 + 0.007 * attempt, "a beat that waited was not read first")


def deaf_control_in_the_cloud() -> None:
    """A cloud whose control heard nothing until its lease was over acts under the next grant as if nothing had been."""
    stage = Stage(settings=Settings(hold_down_initial_s=0.1))  # within the second in which the robot counts as live
    stage.in_cloud()
    control = stage.cloud.control
    hears = control.beat
    setattr(control, "beat", lambda *_beat: None)  # noqa: B010 - a full inbox
    stage.until_phase(Phase.TO_CLOUD, 1.5, "the robot asks the cloud again")
    stage.run(0.06)  # what was said before is over
    setattr(control, "beat", hears)  # noqa: B010
    stage.until_phase(Phase.CLOUD, 2.0, "the cloud is in charge again")


def old_word_for_a_restarted_collector() -> None:
    """A gate of an epoch that has ended, read by a collector that has just restarted, changes nothing."""
    stage = Stage()
    stage.in_cloud()
    collector, machine = stage.robot.collector, stage.machine
    collector.kill(0.05)
    stage.until(lambda: collector.alive, 0.1, "the collector is back")
    old = Charge(Site.ROBOT, Token(machine.incarnation, machine.epoch - 1, ""))
    before = collector.state.charge
    collector.take(SetGate(Gate(machine.started_us, old)))
    stage.expect(collector.state.charge == before, "an epoch that has ended is entered again")


def reports_out_of_place() -> None:
    """A collector that knows nothing reports while the cloud gets ready; the robot goes on as if it had not."""
    stage = Stage()
    stage.start()
    stage.until_phase(Phase.TO_CLOUD, 8.0, "the cloud gets ready")
    epoch = stage.machine.epoch
    stage.robot.control.process.handle(CollectorStatus(GateReport(None, False, True, True)))
    stage.expect(stage.machine.epoch == epoch, "nothing was entered")
    stage.until_phase(Phase.CLOUD, 8.0, "the cloud is in charge")


def node_that_dies_as_the_side_gets_ready() -> None:
    """The robot's node dies while its side gets ready: the cloud goes on."""
    stage = Stage()
    stage.in_cloud()
    stage.hush("robot")
    stage.pin(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.TO_ROBOT and stage.machine.nodes_ready, 1.0, "its nodes are ready")
    stage.robot.nodes["controller"].kill(1.0)
    stage.robot.control.process.guard(Observed("controller", State.UNKNOWN))
    stage.expect(stage.site is Site.CLOUD, "the cloud goes on")


def old_beat_behind_a_newer_one() -> None:
    """A beat of the robot that comes behind a newer one renews nothing."""
    stage = Stage()
    stage.in_cloud()
    process, host = stage.cloud.control.process, stage.cloud.host
    beat = stage.robot.pulse.state
    old = compose(beat, stage.robot.host.now_s() - 0.5, stage.robot.host.wall_us)[1]
    end_s = process.cloud.lease.end_s
    process.arrived(old, host.now_s(), host.wall_us)
    stage.expect(process.cloud.lease.end_s == end_s, "an old beat renews the lease")


def pin_to_the_cloud_during_a_takeover() -> None:
    """A pin to the cloud while the robot takes over: the robot finishes, and the cloud acts when it can."""
    stage = Stage()
    stage.in_cloud()
    join = stage.cut()
    stage.until_phase(Phase.TAKEOVER, 1.0, "the robot takes over")
    stage.pin(Site.CLOUD)
    stage.until_phase(Phase.ROBOT, 1.0, "the robot acts in spite of the pin")
    join()
    stage.until_phase(Phase.CLOUD, 12.0, "the pin is obeyed once the cloud is there again")


STORIES = (
    pin_to_the_cloud_during_a_takeover,
    old_word_for_a_restarted_collector,
    reports_out_of_place,
    node_that_dies_as_the_side_gets_ready,
    old_beat_behind_a_newer_one,
    old_gate_after_a_fallback,
    old_gate_after_a_restart,
    new_control_while_the_cloud_is_next,
    changed_over_just_before_it_was_called_off,
    beat_behind_other_words,
    deaf_control_in_the_cloud,
)
