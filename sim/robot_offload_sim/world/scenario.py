"""The setup of a stretch of simulated time: settings, nodes, outputs and a link, drawn from the seed."""

from __future__ import annotations

import random
from dataclasses import dataclass, field, replace
from functools import cached_property

from robot_offload_core.data.process import DataPlan, InputPlan, OutputPlan
from robot_offload_core.fence.token import Site
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words import shape
from robot_offload_core.words.declared import StateSpec
from robot_offload_core.words.settings import InputSpec, Mode, NodeSpec, OutputSpec, Settings

UID = "wheelchair-7"


@dataclass(frozen=True)
class Replica:
    """What a node of the user publishes.

    Attributes:
        output: index of its output; None: it publishes nothing.
        period_s: period of its timer.
        on_activate: whether the timer is made at activation, so that the first message comes a period later.
        size: bytes of a message.
    """

    output: int | None = None
    period_s: float = 1.0
    on_activate: bool = False
    size: int = 200


@dataclass(frozen=True)
class Scenario:
    """A world before anything happens.

    Attributes:
        settings: valid (checked) settings of the switch, on the robot.
        cloud_settings: settings that the cloud was given.
        outputs: collected outputs; output 0 drives the wheels.
        mirrored: outputs with consumers in the cloud.
        inputs: topics to the cloud.
        input_periods_s: period of each, on the robot.
        robot_nodes, cloud_nodes: managed nodes of each side, in bring-up order.
        replicas, cloud_replicas: what each node publishes.
        inbox: datagrams that wait for a stopped process (10 by default on many kernels, 512 with systemd).
        awake: whether the robot's nodes run already when its agent starts.
        late_s: how much later than the other processes of its side each control starts.
        transition_s: longest normal lifecycle transition.
        tick_s, report_s: how often control ticks, and how often the collector looks for news.
        delay_s, jitter_s: one way.
        relay: services and actions that are served; None: there are no relays.
        drops: whether reopening a session discards messages under way.
        strict: whether a second publisher stops the wheels.
        asked: settings that people request at run time.
        worlds: additional worlds of this stretch, see worlds.py.
        best_effort: outputs, by index, whose lost messages are not sent again.
        states: state of nodes that the standby is to know, by name.
        state_period_s: how often it is published.
        cloud_inputs: the inputs as the cloud's configuration lists them; (): as the robot's.
    """

    settings: Settings
    cloud_settings: Settings
    outputs: tuple[OutputSpec, ...]
    mirrored: tuple[int, ...]
    inputs: tuple[InputPlan, ...]
    input_periods_s: tuple[float, ...]
    robot_nodes: tuple[NodeSpec, ...]
    cloud_nodes: tuple[NodeSpec, ...]
    replicas: dict[str, Replica]
    cloud_replicas: dict[str, Replica]
    inbox: int = 64
    awake: bool = False
    late_s: tuple[float, float] = (0.0, 0.0)
    transition_s: float = 0.015
    tick_s: float = 0.010
    report_s: float = 0.020
    delay_s: float = 0.005
    jitter_s: float = 0.0005
    drops: bool = True
    relay: RelayPlan | None = None
    strict: bool = False
    asked: tuple[Settings, ...] = ()
    worlds: tuple[str, ...] = ()
    best_effort: tuple[int, ...] = ()
    states: dict[str, StateSpec] = field(default_factory=dict)
    state_period_s: float = 0.1

    cloud_inputs: tuple[InputPlan, ...] = ()

    @cached_property
    def input_specs(self) -> tuple[InputSpec, ...]:
        """Return the inputs as the core judges them."""
        return tuple(InputSpec(i.name, i.max_age_ms / 1e3) for i in self.inputs)

    @cached_property
    def publishers(self) -> tuple[str, ...]:
        """Return the node of each output; "" for an output without a publisher."""
        names = {replica.output: name for name, replica in self.replicas.items()}
        return tuple(names.get(i, "") for i in range(len(self.outputs)))

    @cached_property
    def data_plan(self) -> DataPlan:
        """Return what the data processes need."""
        outputs = tuple(
            OutputPlan(o.name, o.deadline_s, i in self.mirrored, o.of_cloud, o) for i, o in enumerate(self.outputs)
        )
        return DataPlan(self.inputs, outputs)

    def shape(self, site: Site) -> str:
        """Return the digest of everything numbered by its position in a side's configuration."""
        plan = self.cloud_plan if site is Site.CLOUD else self.data_plan
        required = ((i.name, i.name) for i in plan.inputs if i.max_age_ms > 0)
        return shape.shape(required, ((o.name, o.name) for o in plan.outputs))

    @cached_property
    def cloud_plan(self) -> DataPlan:
        """Return what the cloud's data process needs; a story may give its inputs another order."""
        return replace(self.data_plan, inputs=self.cloud_inputs or self.inputs)

    @property
    def reaction_s(self) -> float:
        """Time from a passed deadline to the resulting command: a report, a tick, hand-overs."""
        return self.tick_s + self.report_s + 0.010


def draw(dice: random.Random) -> Scenario:
    """Return a scenario; most are the defaults with short hold-downs, some pin, prefer the robot, or only observe."""
    hot_robot, hot_cloud = dice.random() < 0.25, dice.random() < 0.25
    two = dice.random() < 0.5
    outputs = (OutputSpec("cmd_vel", 0.15), *((OutputSpec("arm", 0.20),) if two else ()), OutputSpec("plan", 0.0))
    controller = NodeSpec("controller", core=True)
    arm = NodeSpec("arm", core=True)
    planner = NodeSpec("planner")
    wheels = NodeSpec("wheels", duplicated=False, core=True)
    duplicated = (controller, *((arm,) if two else ()), planner)
    settings = _settings(dice)
    periods_s = settings.robot_period_s, settings.cloud_period_s
    replicas, cloud_replicas = (
        {"wheels": Replica(), **{node.name: Replica(i, period_s) for i, node in enumerate(duplicated)}}
        for period_s in periods_s
    )
    return Scenario(
        settings=settings,
        cloud_settings=settings,
        outputs=outputs,
        mirrored=(0,),
        inputs=(InputPlan("scan", 300), InputPlan("map", latched=True)),
        input_periods_s=(0.05, 5.0),
        robot_nodes=(wheels, *(replace(n, hot=hot_robot) for n in duplicated)),
        cloud_nodes=tuple(replace(n, hot=hot_cloud) for n in duplicated),
        replicas=replicas,
        cloud_replicas=cloud_replicas,
        inbox=dice.choice((10, 10, 64, 512)),
        awake=dice.random() < 0.3,
        late_s=(dice.choice((0.0, 0.7)) * dice.random(), dice.choice((0.0, 0.7)) * dice.random()),
        transition_s=dice.choice((0.015, 0.015, 0.12)),
        tick_s=dice.choice((0.010, 0.030)),
        report_s=dice.choice((0.020, 0.060)),
        delay_s=dice.uniform(0.002, 0.018),
        jitter_s=dice.uniform(0.0002, 0.0015),
        drops=dice.random() < 0.5,
    )


def _settings(dice: random.Random) -> Settings:
    settings = Settings(
        hold_down_initial_s=dice.choice((0.2, 0.5, 1.0)),
        hold_down_max_s=2.0,
        flap_window_s=3.0,
        manual_hold_s=dice.choice((1.0, 3.0)),
        min_dwell_s=dice.choice((0.0, 0.0, 1.0)),
    )
    draw_ = dice.random()
    if draw_ < 0.03:
        settings = replace(settings, mode=Mode.OBSERVE)
    elif draw_ < 0.07:
        settings = replace(settings, prefer=Site.ROBOT)
    elif draw_ < 0.11:
        settings = replace(settings, pin=Site.CLOUD)
    elif draw_ < 0.13:
        settings = replace(settings, pin=Site.ROBOT)
    elif draw_ < 0.25:  # a slower loop: longer periods, longer limits
        settings = replace(
            settings, robot_period_s=0.1, loss_timeout_s=0.11, lease_s=0.35, max_command_age_s=0.25,
            activation_deadline_s=0.4,
        )  # fmt: skip
    settings.check()
    return settings
