"""Faults of whole hosts and of the workload: a steady clock that stands still, control in slices, nothing to do."""

from __future__ import annotations

from robot_offload_sim.faults.fault_types import Fault, Kind, Undo, nothing, option, raised
from robot_offload_sim.sides.system import System

SLICE_S = 0.010


def _idle(run: System, fault: Fault) -> Undo:
    """Silence the replicas of one output on both sides: there is nothing to do."""
    named = [name for name in run.scenario.publishers if name in run.robot.nodes and name in run.cloud.nodes]
    name, _ = option(named, fault.pick)
    return raised([run.robot.nodes[name], run.cloud.nodes[name]], "hung", 1)


def _stutter(run: System, fault: Fault) -> Undo:
    """Stop the robot's control repeatedly, for a long time."""
    control, off_s, end_s = run.robot.control, 0.04 + 0.15 * fault.pick, run.world.now + fault.duration_s

    def stop() -> None:
        if run.world.now < end_s:
            control.stop_for(off_s)
            run.world.after(off_s + SLICE_S, stop)

    stop()
    return nothing


def _stand(run: System, fault: Fault) -> Undo:
    """Pause the cloud's virtual machine with its steady clock: no process there can notice."""
    host = run.cloud.host
    host.stand(fault.duration_s)
    return nothing


def _mute(run: System, fault: Fault) -> Undo:
    """Silence the state of a node: the standby's knowledge ages."""
    del fault
    return nothing if run.keeping is None else raised(tuple(run.keeping.sides.values()), "silent", 1)


HOSTS: dict[str, Kind] = {
    "idle": Kind(0.8, (0.3, 5.0), _idle),
    "stutter": Kind(0.8, (0.5, 5.0), _stutter),
    "stand": Kind(0.8, (0.05, 2.0), _stand, 0.5),
    "mute": Kind(0.4, (0.3, 4.0), _mute, 1.0),
}
