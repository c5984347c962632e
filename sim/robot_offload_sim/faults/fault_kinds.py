"""The kinds of faults: what each does to the link, the processes and the nodes, and how it ends."""

from __future__ import annotations

from collections.abc import Callable

from robot_offload_core.control.robot import placement
from robot_offload_core.control.robot.changeovers import PREPARE_EXTRA_S
from robot_offload_core.fence import envelope
from robot_offload_core.fence.token import Site
from robot_offload_sim.faults.fault_hosts import HOSTS
from robot_offload_sim.faults.fault_types import Fault, Kind, Undo, nothing, option, raised
from robot_offload_sim.faults.strangers import OtherRobot, babble, other_cloud
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.link_model import REPLAY_SPREAD_S, Session, Wire
from robot_offload_sim.world.nodes import Node
from robot_offload_sim.world.world import Process


def _wires(run: System, pick: float) -> tuple[list[Wire], float]:
    """Return some wires: one direction or both, of pulse, data or (mostly) both."""
    both = [run.link.pulse, run.link.data]
    sessions: list[list[Session]] = [both, both, [run.link.pulse], [run.link.data]]
    chosen, pick = option(sessions, pick)
    way, pick = option(("both", "both", "up", "down"), pick)
    wires = [w for s in chosen for w in ((s.up, s.down) if way == "both" else (getattr(s, way),))]
    return wires, pick


def _cut(run: System, fault: Fault) -> Undo:
    wires, pick = _wires(run, fault.pick)
    held = pick < 0.5
    for wire in wires:
        wire.cut_held += held
        wire.cut_lost += not held

    def undo() -> None:
        for wire in wires:
            wire.cut_held -= held
            wire.cut_lost -= not held
            wire.release()

    return undo


def _clean_cut(run: System, fault: Fault) -> Undo:
    """Cut both sessions in both directions at once; what is under way is lost."""
    del fault
    wires = (run.link.pulse.up, run.link.pulse.down, run.link.data.up, run.link.data.down)
    return raised(wires, "cut_lost", 1)


def _starve(run: System, fault: Fault) -> Undo:
    """Give one process of the robot its processor time in slices."""
    process, pick = option((run.robot.control, run.robot.control, run.robot.collector, run.robot.data), fault.pick)
    off_s = 0.03 + 0.2 * pick**2
    end_s = run.world.now + fault.duration_s

    def slice_() -> None:
        if run.world.now < end_s:
            process.stop_for(off_s)
            run.world.after(off_s + 0.012, slice_)

    slice_()
    return nothing


def _loss(run: System, fault: Fault) -> Undo:
    wires, pick = _wires(run, fault.pick)
    share = 0.05 + 0.7 * pick
    for wire in wires:
        wire.losses.append(share)

    def undo() -> None:
        for wire in wires:
            wire.losses.remove(share)

    return undo


def _data_loss(run: System, fault: Fault) -> Undo:
    """Break the data session, or let none of its messages arrive."""
    session = run.link.data
    session.reopen()
    session.down.cut_lost += 1

    def undo() -> None:
        session.down.cut_lost -= 1

    return undo


def _slow(run: System, fault: Fault) -> Undo:
    wires, pick = _wires(run, fault.pick)
    return raised(wires, "extra_s", 0.01 + 0.25 * pick)


def _double(run: System, fault: Fault) -> Undo:
    wires, pick = _wires(run, fault.pick)
    return raised(wires, "doubled", 0.1 + 0.4 * pick)


def _reorder(run: System, fault: Fault) -> Undo:
    return raised(_wires(run, fault.pick)[0], "reordering", 1)


def _agents(run: System) -> list[Process]:
    return [*run.robot.processes, *run.cloud.processes]


def _kill(run: System, fault: Fault) -> Undo:
    process, _ = option(_agents(run), fault.pick)
    process.kill(fault.duration_s)
    return nothing


def _stop(run: System, fault: Fault) -> Undo:
    process, _ = option(_agents(run), fault.pick)
    process.stop_for(fault.duration_s)
    return nothing


def _stop_and_kill(run: System, fault: Fault) -> Undo:
    """Stop one process while another of the same host is killed and comes back."""
    side, pick = option((run.robot.processes, run.cloud.processes), fault.pick)
    stopped, pick = option((side[0], side[0], side[0], *side), pick)  # mostly control
    killed, _ = option([p for p in side if p is not stopped], pick)
    stopped.stop_for(fault.duration_s)
    killed.kill(min(fault.duration_s, 0.05 + 0.5 * pick))
    return nothing


def _named(run: System, name: str) -> Process:
    return next(process for process in _agents(run) if process.name == name)


def _stall(name: str) -> Callable[[System, Fault], Undo]:
    """Stop one process for about as long as the time limits are."""

    def apply(run: System, fault: Fault) -> Undo:
        _named(run, name).stop_for(fault.duration_s)
        return nothing

    return apply


def _end(name: str) -> Callable[[System, Fault], Undo]:
    """Kill one process; it is back as soon as the supervisor can restart it."""

    def apply(run: System, fault: Fault) -> Undo:
        _named(run, name).kill(fault.duration_s)
        return nothing

    return apply


def _outlived_gate(run: System, fault: Fault) -> Undo:
    """Stop control and collector together; the collector goes on first, with old gates in its inbox."""
    run.robot.collector.stop_for(fault.duration_s)
    run.robot.control.stop_for(fault.duration_s + 0.3)
    return nothing


def _robot_hangs(run: System, fault: Fault) -> Undo:
    """Stop everything that the user runs on the robot."""
    for node in run.robot.nodes.values():
        node.stop_for(fault.duration_s)
    return nothing


def _late_changeover(run: System, fault: Fault) -> Undo:
    """Let the robot's outputs flow just before a preparation's deadline; the collector notices just after it."""
    silent_s = run.scenario.settings.activation_deadline_s + PREPARE_EXTRA_S - fault.at_s - 0.06
    _hush(run, 1)
    run.world.after(silent_s, _hush, run, -1)
    run.world.after(silent_s, run.robot.collector.stop_for, 0.1)
    return nothing


def _hush(run: System, sign: int) -> None:
    for node in run.robot.nodes.values():
        node.hung += sign


def _brink(run: System, fault: Fault) -> Undo:
    """Stop the robot's control for almost exactly a lease."""
    run.robot.control.stop_for(run.scenario.settings.lease_s - 0.02 * fault.pick)
    return nothing


def _change_of_mind(run: System, fault: Fault) -> Undo:
    """Let a person ask for the robot and at once for the cloud again."""
    control = run.robot.control
    control.deliver(control.step, placement.SwitchByHand(Site.ROBOT))
    run.world.after(0.005 * fault.pick, control.deliver, control.step, placement.SwitchByHand(Site.CLOUD))
    return nothing


def _amnesia(run: System, fault: Fault) -> Undo:
    """Kill a pulse process, restarted at once, amid losses and repetitions of its beats."""
    process, pick = option((run.robot.pulse, run.cloud.pulse), fault.pick)
    wires = (run.link.pulse.up, run.link.pulse.down)
    share = 0.2 + 0.4 * pick
    for wire in wires:
        wire.doubled += 0.6
        wire.losses.append(share)
    run.world.after(0.03, process.kill, 0.05)

    def undo() -> None:
        for wire in wires:
            wire.doubled = max(0.0, wire.doubled - 0.6)
            wire.losses.remove(share)

    return undo


def _replay(run: System, fault: Fault) -> Undo:
    """Let messages and effects that left the cloud arrive again, mostly those of earlier epochs."""
    data = run.robot.data
    old = list(run.cloud.data.sent)
    if fault.pick < 0.6:
        old = [m for m in old if envelope.decode(m[2].header).token != run.cloud.data.token] or old
    for number, sent in enumerate(old[-12:]):
        run.world.after(number * fault.duration_s / 12, data.deliver, data.arrived, *sent)
    if old:
        token = envelope.decode(old[0][2].header).token
        run.world.after(fault.duration_s / 2, data.deliver, data.arrived, "effect", b"", token)
    return nothing


def _late_nodes(run: System, fault: Fault) -> Undo:
    """Let the transitions of one side's nodes take about as long as a preparation may."""
    side, pick = option((run.robot.nodes, run.robot.nodes, run.cloud.nodes), fault.pick)
    slow_s = run.scenario.settings.activation_deadline_s + PREPARE_EXTRA_S - 0.06 + 0.06 * pick
    return raised([node for node in side.values() if node.spec.duplicated], "slow_s", slow_s)


def _late_cloud(run: System, fault: Fault) -> Undo:
    """Let the cloud's nodes take their time to wake, within the deadline."""
    nodes = [node for node in run.cloud.nodes.values() if node.spec.duplicated]
    return raised(nodes, "slow_s", 0.1 + 0.1 * fault.pick)


def _freeze(run: System, fault: Fault) -> Undo:
    host, _ = option((run.robot.host, run.cloud.host), fault.pick)
    host.freeze()
    return host.thaw


def _node(run: System, pick: float) -> Node:
    return option([*run.robot.nodes.values(), *run.cloud.nodes.values()], pick)[0]


def _crash(run: System, fault: Fault) -> Undo:
    _node(run, fault.pick).kill(fault.duration_s)
    return nothing


def _hang(run: System, fault: Fault) -> Undo:
    node = _node(run, fault.pick)
    if fault.pick * 97 % 1 < 0.5:
        node.stop_for(fault.duration_s)
        return nothing
    node.hung += 1

    def undo() -> None:
        node.hung -= 1

    return undo


def _troubled(run: System, fault: Fault) -> Undo:
    """Make the transitions of one side's nodes slow, refused, or without a reply."""
    side, pick = option((run.robot.nodes, run.cloud.nodes), fault.pick)
    how, pick = option(("slow", "refusing", "mute"), pick)
    nodes = list(side.values())
    if pick < 0.5:
        nodes = [option(nodes, pick * 2)[0]]

    attribute, by = {
        "slow": ("slow_s", 0.05 + 1.5 * pick**2), "refusing": ("refusing", 1), "mute": ("mute", 1),
    }[how]  # fmt: skip
    return raised(nodes, attribute, by)


def _clock_step(run: System, fault: Fault) -> Undo:
    host, pick = option((run.robot.host, run.cloud.host), fault.pick)
    step_us = round((pick - 0.5) * 2e6)
    host.wall_us += step_us

    def undo() -> None:
        host.wall_us -= step_us

    return undo


def _driver(run: System, fault: Fault) -> Undo:
    if fault.pick < 0.5:
        run.driver.kill(fault.duration_s)
        return nothing
    run.driver.slow_s += 0.05

    def undo() -> None:
        run.driver.slow_s = max(0.0, run.driver.slow_s - 0.05)

    return undo


def _input_silent(run: System, fault: Fault) -> Undo:
    index = option(list(range(len(run.scenario.inputs))), fault.pick)[0]
    run.silent_inputs.append(index)
    return lambda: run.silent_inputs.remove(index)


def _other_robot(run: System, fault: Fault) -> Undo:
    return OtherRobot(run, fault.pick).leave


def _other_cloud(run: System, fault: Fault) -> Undo:
    return other_cloud(run, fault.duration_s, fault.pick)


def _bare(run: System, fault: Fault) -> Undo:
    """Let the cloud's beats arrive without their content, like those of a foreign heartbeat publisher."""
    del fault
    pulse = run.cloud.pulse
    pulse.bare += 1

    def undo() -> None:
        pulse.bare -= 1

    return undo


def _babble(run: System, fault: Fault) -> Undo:
    return babble(run, fault.duration_s)


def _hand(run: System, fault: Fault) -> Undo:
    """Let a person switch or pin at the worst moment."""
    site, pick = option((Site.ROBOT, Site.CLOUD), fault.pick)
    until_s = run.robot.host.now_s() + fault.duration_s
    events: tuple[placement.Event, ...] = (
        placement.SwitchByHand(site), placement.SetPin(placement.Wish(site, until_s)), placement.SetPin(None),
    )  # fmt: skip
    event, _ = option(events, pick)
    run.robot.control.deliver(run.robot.control.step, event)
    return nothing


KINDS: dict[str, Kind] = {
    "cut": Kind(5.0, (0.03, 3.0), _cut),
    "clean cut": Kind(1.0, (0.2, 2.0), _clean_cut),
    "starve": Kind(1.0, (0.3, 2.5), _starve),
    "loss": Kind(3.0, (0.3, 4.0), _loss),
    "data loss": Kind(0.7, (0.1, 1.5), _data_loss),
    "slow": Kind(3.0, (0.1, 3.0), _slow),
    "double": Kind(1.5, (0.3, 2.0), _double, REPLAY_SPREAD_S),
    "reorder": Kind(1.5, (0.3, 2.0), _reorder),
    "kill": Kind(4.0, (0.05, 0.6), _kill),
    "stop": Kind(6.0, (0.03, 2.5), _stop),
    "stop and kill": Kind(2.0, (0.05, 1.5), _stop_and_kill),
    "stall control": Kind(1.5, (0.08, 0.32), _stall("robot/control")),
    "stall collector": Kind(0.7, (0.08, 0.32), _stall("robot/collector")),
    "stall cloud": Kind(0.7, (0.08, 0.32), _stall("cloud/control")),
    "stop control": Kind(0.7, (0.26, 0.9), _stall("robot/control")),
    "kill control": Kind(0.7, (0.05, 0.15), _end("robot/control")),
    "kill collector": Kind(0.7, (0.05, 0.15), _end("robot/collector")),
    "outlived gate": Kind(0.5, (0.26, 0.42), _outlived_gate, 0.3),
    "robot hangs": Kind(0.5, (0.1, 0.6), _robot_hangs),
    "brink": Kind(0.4, (0.5, 0.5), _brink),
    "change of mind": Kind(0.4, (0.01, 0.02), _change_of_mind),
    "late changeover": Kind(0.1, (1.5, 1.5), _late_changeover),
    "amnesia": Kind(1.0, (0.1, 0.6), _amnesia, REPLAY_SPREAD_S),
    "replay": Kind(1.5, (0.005, 0.1), _replay),
    "late nodes": Kind(2.5, (1.0, 5.0), _late_nodes),
    "late cloud": Kind(0.3, (0.2, 1.0), _late_cloud),
    "freeze": Kind(2.0, (0.03, 2.0), _freeze),
    "blink": Kind(0.5, (0.06, 0.16), _freeze),
    "crash": Kind(2.5, (0.2, 2.0), _crash),
    "hang": Kind(2.0, (0.1, 2.0), _hang),
    "troubled": Kind(4.0, (0.3, 4.0), _troubled),
    "clock step": Kind(0.5, (0.3, 3.0), _clock_step),
    "driver": Kind(1.0, (0.1, 1.0), _driver),
    "input silent": Kind(1.0, (0.3, 2.0), _input_silent),
    "other robot": Kind(0.8, (0.2, 3.0), _other_robot),
    "other cloud": Kind(0.8, (0.2, 3.0), _other_cloud),
    "bare": Kind(0.7, (0.05, 1.5), _bare),
    "hand": Kind(2.0, (0.02, 0.5), _hand),
    "babble": Kind(0.5, (0.1, 1.0), _babble),
} | HOSTS
