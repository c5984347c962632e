"""Differences between stretches of the storms besides settings: each draws a few worlds, so that an hour has all.

A world changes the scenario of a stretch before it begins, and may cause events in it that are not faults: settings
that change, pods that are replaced, nodes that stay dead, other publishers.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from robot_offload_core.fence.token import Site
from robot_offload_core.words.declared import SettingsError, SnapshotState, StateSpec
from robot_offload_core.words.settings import Mode, NodeSpec, OutputSpec, Settings
from robot_offload_sim.faults import garbage
from robot_offload_sim.promises.promises import OTHERS
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload
from robot_offload_sim.world.scenario import Replica, Scenario
from robot_offload_sim.world.world import Process

FOREVER_S = 1e9
OTHERS_S = 0.033
SHARES = (1, 2, 2, 3, 3)
"""How many worlds a stretch draws."""
BIG = 60_000
"""Bytes of a message; three of them fill a socket."""
CHANGES_PER_S = 0.15
SOON_S = (2.0, 26.0)

Make = Callable[[Scenario, random.Random], Scenario]
Happen = Callable[[System, random.Random], None]


@dataclass(frozen=True)
class Kind:
    """A world: how it changes the scenario, and its events; `only_link`: also where only the link fails."""

    make: Make
    happen: Happen = field(default=lambda _system, _dice: None)
    only_link: bool = True


def draw(dice: random.Random, *, only_link: bool) -> tuple[str, ...]:
    """Return the names of the worlds of a stretch."""
    names = [name for name, kind in KINDS.items() if kind.only_link or not only_link]
    return tuple(dice.sample(names, dice.choice(SHARES)))


def made(scenario: Scenario, names: tuple[str, ...], dice: random.Random) -> Scenario:
    """Return the scenario changed by these worlds."""
    for name in names:
        scenario = KINDS[name].make(scenario, dice)
    return replace(scenario, worlds=names)


def happen(system: System, dice: random.Random) -> None:
    """Plan what happens in the worlds of a scenario."""
    for name in system.scenario.worlds:
        KINDS[name].happen(system, dice)


# -- nodes and outputs ------------------------------------------------------------------------------------------------


def _with_output(scenario: Scenario, spec: NodeSpec, output: OutputSpec, replica: Replica) -> Scenario:
    """Add a duplicated node with an output of its own, at the end."""
    replica = replace(replica, output=len(scenario.outputs))
    return replace(
        scenario,
        outputs=(*scenario.outputs, output),
        robot_nodes=(*scenario.robot_nodes, spec),
        cloud_nodes=(*scenario.cloud_nodes, spec),
        replicas=scenario.replicas | {spec.name: replica},
        cloud_replicas=scenario.cloud_replicas | {spec.name: replica},
    )


def _slow(scenario: Scenario, dice: random.Random) -> Scenario:
    """Add an output of 0.5 or 0.05 Hz, rated or not, mostly from a timer that is made at activation."""
    period_s = dice.choice((2.0, 2.0, 20.0))
    rated = dice.random() < 0.6
    output = OutputSpec("battery", 2.25 * period_s if rated else 0.0, period_s)
    on_activate = dice.random() < 0.7
    return _with_output(scenario, NodeSpec("battery"), output, Replica(None, period_s, on_activate))


def _idle(scenario: Scenario, dice: random.Random) -> Scenario:
    """Add an output without a rate that publishes now and then, for a while."""
    return _with_output(scenario, NodeSpec("goals"), OutputSpec("goal", 0.0), Replica(None, dice.choice((3.0, 9.0))))


def _plain(scenario: Scenario, dice: random.Random) -> Scenario:
    """Make one of the nodes, sometimes all of them, run on both sides without a lifecycle."""
    names = [node.name for node in scenario.cloud_nodes if node.duplicated]
    chosen = set(names) if dice.random() < 0.3 else {dice.choice(names)}

    def plain(nodes: tuple[NodeSpec, ...]) -> tuple[NodeSpec, ...]:
        return tuple(replace(n, lifecycle=False, hot=True) if n.name in chosen else n for n in nodes)

    return replace(scenario, robot_nodes=plain(scenario.robot_nodes), cloud_nodes=plain(scenario.cloud_nodes))


def _hot(scenario: Scenario, dice: random.Random) -> Scenario:
    """Make the nodes of rated outputs Hot on both sides, with known rates: a missing message is a loss."""
    names = {i: name for i, name in enumerate(scenario.publishers) if scenario.outputs[i].rated and name}

    def hot(nodes: tuple[NodeSpec, ...]) -> tuple[NodeSpec, ...]:
        return tuple(replace(n, hot=True) if n.name in names.values() else n for n in nodes)

    outputs = tuple(
        replace(o, period_s=o.period_s or scenario.settings.slower_period_s, nodes=(names[i],), hot=tuple(Site))
        if i in names
        else o
        for i, o in enumerate(scenario.outputs)
    )
    del dice
    return replace(
        scenario, outputs=outputs, robot_nodes=hot(scenario.robot_nodes), cloud_nodes=hot(scenario.cloud_nodes)
    )


def _latched(scenario: Scenario, dice: random.Random) -> Scenario:
    """Add an output whose last value late subscribers receive."""
    output = OutputSpec("plan_shown", 0.0, nodes=("shower",), latched=True)
    return _with_output(scenario, NodeSpec("shower"), output, Replica(None, dice.choice((2.0, 7.0))))


def _order(scenario: Scenario, dice: random.Random) -> Scenario:
    """Bring nodes up in another order: those that are not CORE may come first."""
    robot, cloud = list(scenario.robot_nodes), list(scenario.cloud_nodes)
    dice.shuffle(robot)
    dice.shuffle(cloud)
    return replace(scenario, robot_nodes=tuple(robot), cloud_nodes=tuple(cloud))


def _die(system: System, dice: random.Random) -> None:
    """Kill a node that is not CORE permanently on one side or both; sometimes a CORE node of the cloud."""
    sides = dice.choice(((system.robot,), (system.cloud,), (system.robot, system.cloud)))
    for side in sides:
        system.world.at(dice.uniform(*SOON_S), side.nodes["planner"].kill, FOREVER_S)
    if dice.random() < 0.2:
        system.world.at(dice.uniform(*SOON_S), system.cloud.nodes["controller"].kill, FOREVER_S)


def _results(scenario: Scenario, dice: random.Random) -> Scenario:
    """Add a node with placement Cloud, whose results pass whichever side is in charge."""
    index = len(scenario.outputs)
    output = OutputSpec(
        "detections", 0.3, 0.1, of_cloud=True, nodes=("detector",), max_age_s=dice.choice((0.0, 0.1, 0.2))
    )
    detector = NodeSpec("detector", duplicated=False)
    return replace(
        scenario,
        outputs=(*scenario.outputs, output),
        cloud_nodes=(*scenario.cloud_nodes, detector),
        cloud_replicas=scenario.cloud_replicas | {"detector": Replica(index, 0.1)},
    )


def _shared(scenario: Scenario, dice: random.Random) -> Scenario:
    """Add a topic that both the group and others publish, with consumers on both sides."""
    output = OutputSpec("poses", 0.0, shared=True, nodes=("localizer",))
    scenario = _with_output(scenario, NodeSpec("localizer"), output, Replica(None, dice.choice((0.05, 0.2))))
    return replace(scenario, mirrored=(*scenario.mirrored, len(scenario.outputs) - 1))


def _say(system: System, dice: random.Random) -> None:
    """Publish on the robot's shared topic as others do, without end."""
    del dice
    index = next(i for i, output in enumerate(system.scenario.outputs) if output.shared)
    collector, said = system.robot.collector, 0

    def say() -> None:
        nonlocal said
        said += 1
        if collector.alive:
            payload = Payload(Site.ROBOT, Message(OTHERS, 1, said, system.world.now), b"", system.world.now)
            collector.post(OTHERS, collector.others, index, payload)
        system.world.after(OTHERS_S, say)

    say()


# -- people, operators, other publishers ------------------------------------------------------------------------------


def _changing(scenario: Scenario, dice: random.Random) -> Scenario:
    """Add settings that a person will request while the robot runs."""
    settings = scenario.settings
    asked: list[Settings] = []
    while len(asked) < 3:
        changed = replace(
            settings,
            lease_s=settings.lease_s * dice.choice((0.9, 1.0, 1.3)),
            loss_timeout_s=settings.loss_timeout_s * dice.choice((1.0, 1.0, 1.2)),
            max_command_age_s=settings.max_command_age_s * dice.choice((0.8, 1.0, 1.2)),
            activation_deadline_s=settings.activation_deadline_s * dice.choice((1.0, 1.3)),
            hold_down_initial_s=dice.choice((0.2, 1.0)),
            prefer=dice.choice((Site.CLOUD, Site.CLOUD, Site.ROBOT)),
            pin=dice.choice((None, None, None, Site.ROBOT, Site.CLOUD)),
            mode=dice.choice((Mode.AUTO, Mode.AUTO, Mode.AUTO, Mode.OBSERVE)),
        )
        try:
            changed.check()
        except SettingsError:
            continue
        asked.append(changed)
    return replace(scenario, asked=tuple(asked))


def _change(system: System, dice: random.Random) -> None:
    control, scenario = system.robot.control, system.scenario
    at_s = SOON_S[0]
    while (at_s := at_s + dice.expovariate(CHANGES_PER_S)) < 50.0:
        settings = dice.choice((scenario.settings, *scenario.asked))
        system.world.at(at_s, control.deliver, _adopt, system, settings)


def _adopt(system: System, settings: Settings) -> None:
    system.world.note("settings change")
    system.robot.control.adopt(settings)


def _replaced(system: System, dice: random.Random) -> None:
    """Replace the cloud's pods: they announce their end, end, and return. Some end before the robot has taken over."""
    for start_s in (dice.uniform(5.0, 15.0), dice.uniform(20.0, 30.0)):
        end_s = start_s + dice.uniform(0.0, 3.0)
        system.world.at(start_s, system.cloud.control.deliver, _announce, system)
        for process in (*system.cloud.processes, *system.cloud.nodes.values()):
            system.world.at(end_s + dice.uniform(0.0, 0.3), _end, system, process, dice.uniform(0.3, 1.0))


def _end(system: System, process: Process, away_s: float) -> None:
    charge = system.robot.collector.state.charge
    if charge is not None and charge.site is Site.CLOUD:
        system.cut_short_s = system.world.now
    process.kill(away_s)


def _announce(system: System) -> None:
    system.world.note("pods go")
    system.cloud.control.announce("node drained")


def _rivalled(scenario: Scenario, dice: random.Random) -> Scenario:
    return replace(scenario, strict=dice.random() < 0.5)


def _rival(system: System, dice: random.Random) -> None:
    """Publish the wheels' topic as another publisher for a while, mostly when all else is quiet."""
    start_s = dice.choice((dice.uniform(4.0, 12.0), dice.uniform(20.0, 23.0)))
    system.world.at(start_s, system.rivals.append, "intruder")
    system.world.at(start_s + dice.uniform(2.0, 6.0), system.rivals.clear)


def _big(scenario: Scenario, dice: random.Random) -> Scenario:
    """Make messages so big that a few fill a socket: the byte limit counts, not the number of datagrams."""
    big = {name: replace(r, size=dice.choice((200, BIG))) for name, r in scenario.replicas.items()}
    cloud = {
        name: replace(r, size=big[name].size if name in big else BIG) for name, r in scenario.cloud_replicas.items()
    }
    return replace(scenario, replicas=big, cloud_replicas=cloud)


def _states(scenario: Scenario, dice: random.Random) -> Scenario:
    """Give the controller state that the standby is to know."""
    states: dict[str, StateSpec] = {"controller_1": SnapshotState("controller", max_age_s=0.5, max_size=1024)}
    return replace(scenario, states=states, state_period_s=dice.choice((0.1, 0.25)))


def _tear(system: System, dice: random.Random) -> None:
    """Tear some snapshots, in most stretches."""
    assert system.keeping is not None
    for kept in system.keeping.sides.values():
        kept.torn = dice.choice((0.0, 0.05, 0.2))


def _garbage(system: System, dice: random.Random) -> None:
    del dice
    garbage.let_in(system.link)


def _as_is(scenario: Scenario, dice: random.Random) -> Scenario:
    del dice
    return scenario


KINDS: dict[str, Kind] = {
    "slow output": Kind(_slow),
    "idle output": Kind(_idle),
    "plain nodes": Kind(_plain),
    "hot standby": Kind(_hot),
    "latched output": Kind(_latched),
    "other order": Kind(_order),
    "dead for good": Kind(_as_is, _die),
    "results": Kind(_results),
    "shared topic": Kind(_shared, _say),
    "changing settings": Kind(_changing, _change, only_link=False),
    "replaced pods": Kind(_as_is, _replaced, only_link=False),
    "second publisher": Kind(_rivalled, _rival, only_link=False),
    "big messages": Kind(_big),
    "snapshots": Kind(_states, _tear),
    "garbage": Kind(_as_is, _garbage),
}
"""Each adds or changes things of its own, so their order does not matter."""
