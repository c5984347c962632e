"""Every ROS parameter of the agent: default, unit, range, meaning; and the configuration read from a parameter file.

The file is an ordinary ROS 2 parameter file (`/**: ros__parameters:`), written by `robot-offload render` or the
operator. Empty lists are written as `["none"]` because ROS parameters have no empty list. The lifecycle nodes
declare these parameters, read-only except for the pin, so `ros2 param list` and `describe` show them.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings.parameter import CALLED, TOPIC, Parameter, Value
from robot_offload_agent.settings.served import SERVED, relay_plan
from robot_offload_agent.settings.states import KEPT, state_spec
from robot_offload_agent.settings.topics import (
    INPUT,
    OUTPUT,
    completed,
    input_spec,
    is_silent,
    output_problems,
    output_spec,
)
from robot_offload_core.fence.token import Site
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words import shape
from robot_offload_core.words.declared import SettingsError, StateSpec
from robot_offload_core.words.settings import InputSpec, Mode, NodeSpec, OutputSpec, Settings

SITES = ("Robot", "Cloud")
SERVICE = rf"({TOPIC})?"

GENERAL: dict[str, Parameter] = {
    "side": Parameter(None, "the side this agent runs on", choices=("robot", "cloud")),
    "uid": Parameter(
        None, "identity of the RobotOffload; both sides must have the same", pattern=r"[A-Za-z0-9._-]{1,63}"
    ),
    "robot_name": Parameter("", "name of the robot, for people"),
    "domain_id": Parameter(0, "ROS domain of this side", low=0, high=232),
    "namespace": Parameter("/", "namespace of the agent's nodes and of relative node names", pattern=rf"/|{TOPIC}"),
    "runtime_dir": Parameter("", "folder for sockets and pid files; empty: in the user's runtime folder"),
    "state_dir": Parameter("", "folder for what outlives a reboot; empty: in the user's state folder"),
    "black_box_mib": Parameter(
        64, "largest size of the black box in state_dir, MiB; 0: none. In the cloud at most 8", low=0, high=65536
    ),
    "generation": Parameter(0, "generation of the resource that this file was made from; 0: none", low=0, high=2**53),
    "state_file": Parameter("", "file to which the cloud's agent writes its state (JSON); empty: none"),
    "settings_file": Parameter("", "parameter file watched in the cloud for settings to push; empty: none"),
    "handover_file": Parameter("", "file watched in the cloud: its text asks the robot to take over; empty: none"),
    "certificate_file": Parameter(
        "", "file watched in the cloud: the answer to the robot's request for a certificate; empty: none is signed"
    ),
    "realtime": Parameter(False, "run under SCHED_FIFO (needs the privilege; a warning is logged when it is missing)"),
    "mode": Parameter(
        "Auto", "Auto switches; Observe only says what it would do", choices=tuple(m.value for m in Mode)
    ),
    "pin": Parameter("Auto", "placement kept by the resource", choices=("Auto", *SITES)),
    "prefer": Parameter("Cloud", "the side to act on when both can", choices=SITES),
    "strict": Parameter(False, "refuse to start when a duplicated node publishes topics that are not declared"),
    "heartbeat_period_ms": Parameter(20.0, "distance of two beats, ms", low=5, high=1000),
    "loss_timeout_ms": Parameter(90.0, "silence of good beats that means loss, ms", low=15, high=10000),
    "lease_ms": Parameter(250.0, "how long a grant lets the cloud act, ms", low=50, high=30000),
    "max_command_age_ms": Parameter(150.0, "oldest cloud message that reaches a consumer, ms", low=10, high=10000),
    "robot_period_ms": Parameter(50.0, "period of the robot's replica, ms", low=1, high=10000),
    "cloud_period_ms": Parameter(20.0, "period of the cloud's replica, ms", low=1, high=10000),
    "tolerance_ms": Parameter(30.0, "price of a switch in the thesis's rule, ms", low=0, high=10000),
    "min_dwell_ms": Parameter(0.0, "least stay before a switch that only the policy asks for, ms", low=0, high=3.6e6),
    "hold_down_initial_ms": Parameter(
        1000.0, "wait after a loss before the cloud is used again, ms", low=0, high=3.6e6
    ),
    "hold_down_max_ms": Parameter(30000.0, "the same after many flaps, ms", low=0, high=3.6e6),
    "flap_window_ms": Parameter(5000.0, "a stay in the cloud shorter than this is a flap, ms", low=0, high=3.6e6),
    "activation_deadline_ms": Parameter(250.0, "in which a side's nodes become Active, ms", low=10, high=60000),
    "max_clock_offset_ms": Parameter(20.0, "largest difference of the system clocks, ms", low=1, high=60000),
    "prepare_deadline_ms": Parameter(
        0.0,
        "in which a side that is chosen gets ready, ms; 0: activation_deadline_ms",
        low=0,
        high=600000,
    ),
    "cancel_deadline_ms": Parameter(
        2000.0, "in which the goals of the side left behind end before its nodes sleep, ms", low=10, high=60000
    ),
    "settle_for_ms": Parameter(
        10000.0, "how long a side that was called off for goals or state stays Active, ms", low=0, high=600000
    ),
    "max_message_size": Parameter(8 << 20, "largest message that is carried, bytes", low=1024, high=16 << 20),
    "silent": Parameter(["none"], "topics of duplicated nodes that are not missed outside their side"),
    "inhibit_service": Parameter("", "std_srvs/SetBool service of the driver; empty: none", pattern=SERVICE),
    "nodes": Parameter(["none"], "managed nodes in bring-up order, by resource name"),
    "outputs": Parameter(["none"], "identifiers of the collected outputs"),
    "inputs": Parameter(["none"], "identifiers of the topics to the cloud"),
    "services": Parameter(["none"], "identifiers of the services that duplicated nodes serve"),
    "actions": Parameter(["none"], "identifiers of the actions that duplicated nodes serve"),
    "used_services": Parameter(["none"], "identifiers of the services outside that duplicated nodes call"),
    "used_actions": Parameter(["none"], "identifiers of the actions outside that duplicated nodes use"),
    "states": Parameter(["none"], "identifiers of what the standby gets to know"),
    "record.switches": Parameter(False, "a recording (MCAP) of each changeover, in state_dir"),
    "record.before_ms": Parameter(20000.0, "how much of the time before a changeover it has, ms", low=0, high=300000),
    "record.after_ms": Parameter(10000.0, "how much of the time after a changeover it has, ms", low=0, high=300000),
    "record.keep": Parameter(50, "recordings kept; the oldest go", low=1, high=10000),
    "record.max_mib": Parameter(64, "largest size of a recording and of the memory for it, MiB", low=1, high=1024),
    "link.type": Parameter("zenoh", "how the two agents reach each other", choices=("zenoh", "ros")),
    "link.pulse_endpoints": Parameter(["none"], "endpoints of the pulse session"),
    "link.data_endpoints": Parameter(["none"], "endpoints of the data session"),
    "link.pulse_fallback": Parameter(["none"], "TLS endpoints of the pulse session where UDP is blocked"),
    "link.data_fallback": Parameter(["none"], "TLS endpoints of the data session where UDP is blocked"),
    "link.fallback_after_ms": Parameter(
        5000.0, "time without a connection before the fallback, ms", low=500, high=600000
    ),
    "link.ca": Parameter("", "PEM file of the certificate authority of the other side"),
    "link.certificate": Parameter("", "PEM file of this side's certificate"),
    "link.private_key": Parameter("", "PEM file of this side's private key"),
    "link.peer_name": Parameter(
        "cloud", "common name of the other side's certificate", pattern=r"[A-Za-z0-9._-]{1,64}"
    ),
    "link.observers": Parameter(["none"], "common names of certificates that may listen at the cloud, say nothing"),
    "link.verify_name": Parameter(True, "check that the cloud's certificate names the address dialled"),
}
NODE: dict[str, Parameter] = {
    "duplicated": Parameter(True, "has a replica on the other side"),
    "core": Parameter(False, "the robot must not move without it"),
    "lifecycle": Parameter(True, "is a managed (lifecycle) node"),
    "may_differ": Parameter(["none"], "names of parameters that may differ between its replicas; `*` is any text"),
    "standby_robot": Parameter("Warm", "Warm: Inactive while the cloud acts; Hot: Active", choices=("Warm", "Hot")),
    "standby_cloud": Parameter("Warm", "the same for the cloud's replica", choices=("Warm", "Hot")),
}
GROUPS = {"nodes": ("node", NODE), "outputs": ("output", OUTPUT), "inputs": ("input", INPUT), **SERVED, **KEPT}
NAMES = {group: rf"{TOPIC}|{TOPIC[1:]}" if group == "nodes" else CALLED for group in GROUPS}
"""Form of the names in these lists: node names may have a namespace, identifiers become parts of other names."""


@dataclass(frozen=True)
class Named:
    """The parameters of one node, output or input, by attribute-like lookup."""

    name: str
    values: Mapping[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.values[key]


@dataclass(frozen=True)
class Configuration:
    """The configuration of one agent. `values` holds every parameter by its full dotted name."""

    values: Mapping[str, Any]
    nodes: tuple[Named, ...]
    outputs: tuple[Named, ...]
    inputs: tuple[Named, ...]
    services: tuple[Named, ...] = ()
    actions: tuple[Named, ...] = ()
    used_services: tuple[Named, ...] = ()
    used_actions: tuple[Named, ...] = ()
    states: tuple[Named, ...] = ()

    def __getitem__(self, key: str) -> Any:
        return self.values[key]

    @property
    def side(self) -> Site:
        """The side that this agent runs on."""
        return Site(self["side"])

    @property
    def runtime_dir(self) -> Path:
        """Folder of sockets, pid files and the collector's memory."""
        if self["runtime_dir"]:
            return Path(self["runtime_dir"])
        base = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
        return Path(base) / "robot-offload" / f"{self['uid']}-{self['side']}"

    def settings(self) -> Settings:
        """Return the core's settings; raise ConfigurationError naming the parameters that cannot work together."""
        seconds = {
            name[: -len("_ms")].replace("heartbeat_period", "beat_period") + "_s": self[name] / 1e3
            for name in GENERAL
            if name.endswith("_ms") and "." not in name
        }
        pin = None if self["pin"] == "Auto" else Site(self["pin"].lower())
        settings = Settings(
            **seconds, prefer=Site(self["prefer"].lower()), pin=pin, mode=Mode(self["mode"]),
            max_message_size=self["max_message_size"],
        )  # fmt: skip
        try:
            settings.check()
        except SettingsError as error:
            text = str(error).replace("beat_period_s", "heartbeat_period_s").replace("_s:", "_ms:", 1)
            raise ConfigurationError(f"parameter {text}") from error
        return settings

    def output_specs(self) -> tuple[OutputSpec, ...]:
        """Return the outputs for the collector's core."""
        return tuple(output_spec(o.name, o.values) for o in self.outputs)

    def input_specs(self) -> tuple[InputSpec, ...]:
        """Return the inputs for the health core, which names them by their topics."""
        return tuple(input_spec(i.values) for i in self.inputs)

    def shape(self) -> str:
        """Return the digest of all that beats refer to by number; the two sides must have the same."""
        required = ((i.name, i["topic"]) for i in self.inputs if i["max_age_ms"] > 0)
        return shape.shape(required, ((o.name, o["topic"]) for o in self.outputs))

    def silent(self, topic: str) -> bool:
        """Return whether a topic is needed only on its own side, by `silent`."""
        return is_silent(topic, listed(self["silent"]), self["namespace"])

    def state_specs(self) -> tuple[StateSpec, ...]:
        """Return the state that the standby receives; raise ConfigurationError naming a parameter that cannot work."""
        return tuple(state_spec(state.name, state.values) for state in self.states)

    def relay_plan(self) -> RelayPlan | None:
        """Return the relay's plan; None without a served or used name. Raise ConfigurationError."""
        declared = {group: [(n.name, n.values) for n in getattr(self, group)] for group in SERVED}
        return relay_plan(declared, self.settings()) if any(declared.values()) else None

    def node_specs(self) -> tuple[NodeSpec, ...]:
        """Return the nodes for the guardian of this side; CORE is a node that the robot cannot do without."""
        hot = "standby_robot" if self.side is Site.ROBOT else "standby_cloud"
        return tuple(
            NodeSpec(
                n.name,
                n["duplicated"],
                n["core"] and (self.side is Site.ROBOT or n["duplicated"]),
                n["lifecycle"],
                n["duplicated"] and (n[hot] == "Hot" or not n["lifecycle"]),
                tuple(o[f"{self.side.value}_topic"] for o in self.outputs if o["node"] == n.name),
            )
            for n in self.nodes
        )


def load(path: Path) -> Configuration:
    """Read a parameter file; raise ConfigurationError naming every parameter that is wrong."""
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise ConfigurationError(f"{path}: {why}; give the file that the bundle contains") from error
    return parse(flatten(read(text, str(path))))


def read(text: str, where: str) -> dict[str, Any]:
    """Return the parameters in the text of a parameter file, as nested blocks; raise ConfigurationError."""
    return block(document(text, where), where)


def document(text: str, where: str) -> Any:
    """Return the content of a YAML text; raise ConfigurationError."""
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader)):
            raise ConfigurationError(f"{where}: aliases (`*name`) are not allowed; write each value out")
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise ConfigurationError(f"{where}: not YAML: {error}") from error


def block(found: Any, where: str) -> dict[str, Any]:
    """Return the parameters of a parameter file's document, as nested blocks; raise ConfigurationError."""
    try:
        tree = found["/**"]["ros__parameters"]
        assert isinstance(tree, dict)
    except (TypeError, KeyError, AssertionError) as error:
        raise ConfigurationError(
            f"{where}: no `/**: ros__parameters:` block, this is not an agent configuration"
        ) from error
    return tree


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested blocks -> dotted names."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def parse(given: Mapping[str, Any]) -> Configuration:
    """Check names, types, ranges; raise ConfigurationError with one line per problem."""
    table = dict(GENERAL)
    problems: list[str] = []
    for group, (prefix, members) in GROUPS.items():
        names = given.get(group, ["none"])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            continue  # told below, with all other types
        if len(set(names)) != len(names):
            problems.append(f"parameter {group}: each name once, found {', '.join(names)}")
        for name in listed(names):
            if not re.fullmatch(NAMES[group], name):
                problems.append(f"parameter {group}: {name!r} has a form that is not allowed")
            table.update({f"{prefix}.{name}.{key}": parameter for key, parameter in members.items()})
    problems += [f"parameter {name}: unknown" for name in given if name not in table]
    values: dict[str, Any] = {}
    for name, parameter in table.items():
        try:
            values[name] = check(parameter, given.get(name, parameter.default))
        except ValueError as error:
            problems.append(f"parameter {name}: {error}")
    if problems:
        raise ConfigurationError("\n".join(problems))
    groups = {
        group: tuple(
            Named(name, completed({key: values[f"{prefix}.{name}.{key}"] for key in members}))
            for name in listed(values[group])
        )
        for group, (prefix, members) in GROUPS.items()
    }
    configuration = Configuration(values, **groups)
    problems = list(contradictions(configuration))
    if problems:
        raise ConfigurationError("\n".join(problems))
    configuration.settings()
    configuration.relay_plan()
    configuration.state_specs()
    return configuration


def contradictions(configuration: Configuration) -> Iterator[str]:
    """Yield values that are valid by themselves but cannot work together."""
    nodes = {node.name for node in configuration.nodes}
    owner: dict[str, str] = {}
    for prefix, members in (("output", configuration.outputs), ("input", configuration.inputs)):
        for member in members:
            for key in ("topic", "robot_topic", "cloud_topic") if prefix == "output" else ("topic",):
                name = f"{prefix}.{member.name}.{key}"
                taken = owner.setdefault(member[key], name)
                if taken != name:
                    yield f"parameter {name}: {member[key]} is {taken} already, messages would go round in circles"
    for output in configuration.outputs:
        elsewhere = output["of_cloud"] and configuration.side is Site.ROBOT
        if output["node"] and output["node"] not in nodes and not elsewhere:
            yield f"parameter output.{output.name}.node: {output['node']} is not one of nodes"
    for output in configuration.outputs:
        yield from output_problems(output.name, output.values)


def too_tight(configuration: Configuration) -> str:
    """Return the limits that are broken although all is well (rules of the core), "" for none."""
    settings = configuration.settings()
    outputs = [(f"output.{o.name}.deadline_ms", o.too_tight()) for o in configuration.output_specs()]
    inputs = [(f"input.{i.name}.max_age_ms", i.too_tight(settings)) for i in configuration.input_specs()]
    return "; ".join(f"{name}: {text}" for name, text in [*outputs, *inputs] if text)


def listed(names: list[str]) -> list[str]:
    """Return a list parameter without the placeholder for an empty list."""
    return [name for name in names if name != "none"]


def check(parameter: Parameter, value: Any) -> Value:
    """Return the value in the parameter's type; raise ValueError stating what is allowed."""
    if value is None:
        raise ValueError("must be given")
    if parameter.type is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    checked: Any = value
    if not _has_type(value, parameter.type):
        raise ValueError(f"{value!r} is no {'list of texts' if parameter.type is list else parameter.type.__name__}")
    low, high = parameter.low, parameter.high
    if low is not None and high is not None and not low <= checked <= high:
        raise ValueError(f"{checked} is not within {low:g} .. {high:g}")
    if parameter.choices and checked not in parameter.choices:
        raise ValueError(f"{checked!r} is none of {', '.join(parameter.choices)}")
    if parameter.pattern and not re.fullmatch(parameter.pattern, checked):
        raise ValueError(f"{checked!r} has a form that is not allowed")
    result: Value = checked
    return result


def _has_type(value: Any, wanted: type) -> bool:
    if wanted is list:
        return isinstance(value, list) and all(isinstance(v, str) for v in value)
    return isinstance(value, wanted) and (wanted is bool or not isinstance(value, bool))
