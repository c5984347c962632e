"""Nodes: which run where, how they are started, and what of theirs goes to whom."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from robot_offload.api.v1alpha1.build import NodeBuild
from robot_offload.api.v1alpha1.model import NO_SERVER_DEFAULT, Model, map_list
from robot_offload.api.v1alpha1.names import (
    ConfigKey,
    ExecutableName,
    ImageName,
    LabelKey,
    LabelValue,
    NodeName,
    ObjectName,
    PackageName,
    RemappedName,
    VariableName,
)
from robot_offload.api.v1alpha1.outputs import Output
from robot_offload.api.v1alpha1.pod_spec import PodSpec
from robot_offload.api.v1alpha1.resources import Resources
from robot_offload.api.v1alpha1.served import Action, Service, State, UsedAction, UsedService, Uses

_SCALARS = (bool, int, float, str)
_PARAMETER = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")
_RENAMING = re.compile(r"(^|:)__(node|ns|name):=")


def _check_parameters(value: Any) -> Any:
    """Return ROS parameters: names to truth values, numbers, texts, lists of one of these, or further mappings."""
    if not isinstance(value, dict):
        raise ValueError("must be a mapping of parameter names to values")
    for name, item in value.items():
        if not isinstance(name, str) or not _PARAMETER.fullmatch(name):
            raise ValueError(f"{str(name)[:40]!a} is not a parameter name; use letters, digits and underscores")
        _check_parameter(name, item)
    return value


def _check_parameter(name: str, value: Any) -> None:
    if isinstance(value, dict):
        _check_parameters(value)
    elif isinstance(value, tuple | list):
        if not value:
            raise ValueError(f"{name} is an empty list; ROS 2 cannot know its type, leave the parameter out")
        if not all(isinstance(item, _SCALARS) for item in value):
            raise ValueError(f"{name} is a list of lists, mappings or nothing; ROS 2 takes lists of plain values")
        if len({type(item) for item in value}) > 1:
            raise ValueError(f"{name} is a list of different things; ROS 2 takes lists of one plain type")
        for item in value:
            _check_parameter(name, item)
    elif not isinstance(value, _SCALARS):
        raise ValueError(f"{name} has no value; write one or leave the parameter out")
    elif isinstance(value, str):
        _check_text(value, name)


def _with_doubles(values: Mapping[str, Any], doubles: Collection[str], prefix: str = "") -> dict[str, Any]:
    """Return `values` with those named as floating-point numbers, whole or not; nested names are joined by dots."""
    return {name: _with_double(f"{prefix}{name}", item, doubles) for name, item in values.items()}


def _with_double(name: str, item: Any, doubles: Collection[str]) -> Any:
    if isinstance(item, Mapping):
        return _with_doubles(item, doubles, f"{name}.")
    if name not in doubles:
        return item
    if isinstance(item, tuple | list):
        return type(item)(float(it) if type(it) is int else it for it in item)
    return float(item) if type(item) is int else item


def flat_parameters(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every parameter with its full name, nested names joined by dots."""
    for name, item in values.items():
        if isinstance(item, Mapping):
            yield from flat_parameters(item, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", item


Parameters = Annotated[
    dict[str, Any],
    BeforeValidator(_check_parameters),
    WithJsonSchema({"type": "object", "x-kubernetes-preserve-unknown-fields": True}),
]
"""Values of ROS parameters as in a parameter file: `{rate_hz: 20.0, plugins: {speed: 0.6}}`."""


def _check_text(text: str, what: str = "this text") -> str:
    """Return what a process can be given: no NUL, which ends a text in C, and nothing that is no character."""
    if "\0" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise ValueError(f"{what} holds a character that no process can be given (NUL or half of one); leave it out")
    return text


def _check_argument(text: str) -> str:
    if not text:
        raise ValueError("must not be empty")
    if _RENAMING.search(text):
        raise ValueError(
            f"{text[:60]!r} renames the node; the agents find it by its name and namespace, so write those in name and "
            "spec.robot.namespace"
        )
    return _check_text(text)


def _check_parameter_name(text: str) -> str:
    if not _PARAMETER.fullmatch(text):
        raise ValueError(f"{text[:40]!a} is not a parameter name; use letters, digits and underscores")
    return text


Argument = Annotated[
    str,
    Field(max_length=4096),
    AfterValidator(_check_argument),
    WithJsonSchema({"type": "string", "minLength": 1, "maxLength": 4096}),
]
ParameterName = Annotated[
    str,
    Field(max_length=255),
    AfterValidator(_check_parameter_name),
    WithJsonSchema({"type": "string", "minLength": 1, "maxLength": 255, "pattern": rf"^{_PARAMETER.pattern}$"}),
]
"""The full name of a parameter; nested names are joined by dots."""


class ConfigMapKeyReference(Model):
    """One entry of a ConfigMap in the same Kubernetes namespace."""

    name: ObjectName = Field(description="The ConfigMap's name.")
    key: ConfigKey = Field(description="The key in it, e.g. nav2.yaml for a ROS 2 parameter file.")


class ParametersFrom(Model):
    """Where a ROS 2 parameter file comes from."""

    config_map_key_ref: ConfigMapKeyReference = Field(description="The entry of a ConfigMap that holds the file.")


class Run(Model):
    """How a node is started: a command, or an executable of a ROS package."""

    command: tuple[Argument, ...] = Field(
        default=(),
        max_length=64,
        description="The program and its arguments, e.g. [python3, controller.py]; files are relative to the "
        "folder of this specification. ROS arguments are added. Either this, or package and executable.",
    )
    package: PackageName | None = Field(
        default=None,
        description="The ROS package of the executable, e.g. nav2_controller. Instead of command.",
    )
    executable: ExecutableName | None = Field(
        default=None, description="The executable in that package, as for `ros2 run`, e.g. controller_server."
    )
    parameters: Parameters = Field(
        default_factory=dict,
        description="ROS parameters of the node on both sides, e.g. {rate_hz: 20.0}. Default: none.",
    )
    cloud_parameters: Parameters = Field(
        default_factory=dict,
        description="ROS parameters that differ in the cloud; they are laid over `parameters`. Default: none.",
    )
    doubles: tuple[ParameterName, ...] = Field(
        default=(),
        max_length=64,
        description="Names of parameters that ROS 2 declares as double and whose value may be whole, e.g. [rate_hz]. "
        "Kubernetes keeps 20.0 as 20, and ROS 2 takes no whole number for a double. Nested names are joined by dots. "
        "Default: none.",
    )
    parameters_from: ParametersFrom | None = Field(
        default=None,
        description="A ROS 2 parameter file for the replica in the cloud; `parameters` and `cloudParameters` are "
        "laid over it. Default: none.",
    )
    remap: dict[RemappedName, RemappedName] = Field(
        default_factory=dict,
        max_length=64,
        description="Remapping of names, from: to, e.g. {cmd_vel_nav: /cmd_vel}. Outputs are remapped on top "
        "of it. Default: none.",
    )

    @model_validator(mode="before")
    @classmethod
    def _read_doubles(cls, value: Any) -> Any:
        """Give back the point that Kubernetes takes away."""
        doubles = value.get("doubles") if isinstance(value, Mapping) else None
        if not isinstance(doubles, tuple | list) or not all(isinstance(name, str) for name in doubles):
            return value
        fields = ("parameters", "cloudParameters", "cloud_parameters")
        mappings = {field: value[field] for field in fields if isinstance(value.get(field), Mapping)}
        return {**value, **{field: _with_doubles(them, doubles) for field, them in mappings.items()}}


class Standby(Model):
    """What a duplicated node does on the side that does not act."""

    robot: Literal["Warm", "Hot"] = Field(
        default="Warm",
        description="On the robot while the cloud acts: Warm (configured, inactive) or Hot (active, its "
        "output held back; takes over at once). Default Warm.",
    )
    cloud: Literal["Cold", "Warm", "Hot"] = Field(
        default="Warm",
        description="In the cloud while the robot acts: Cold (no pod until the robot is connected and may use it), "
        "Warm (configured, inactive) or Hot (active, its output held back). Default Warm.",
    )


MOST_PODS: Final = 32
"""Of one node."""
RESERVED_VARIABLES: Final = (
    "ROS_DOMAIN_ID",
    "RMW_IMPLEMENTATION",
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "ROS_STATIC_PEERS",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_ENVIRONMENT_FILE",
)
"""Environment variables by which nodes find each other; they follow from the resource and cannot be set by hand."""
RESERVED_PREFIX: Final = "ROBOT_OFFLOAD_"
"""How the variables begin that the operator sets itself."""


class SecretKeyReference(Model):
    """One entry of a Secret in the same Kubernetes namespace."""

    name: ObjectName = Field(description="The Secret's name.")
    key: ConfigKey = Field(description="The key in it, whose value the variable gets, e.g. token.")


class ValueFrom(Model):
    """Where the value of an environment variable comes from; read when the pod starts, by Kubernetes itself."""

    secret_key_ref: SecretKeyReference | None = Field(
        default=None, description="The entry of a Secret. Either this, or configMapKeyRef."
    )
    config_map_key_ref: ConfigMapKeyReference | None = Field(
        default=None, description="The entry of a ConfigMap. Instead of secretKeyRef."
    )


class EnvironmentVariable(Model):
    """An environment variable of a container."""

    name: VariableName = Field(description="The variable's name.")
    value: Annotated[str, Field(max_length=4096), AfterValidator(_check_text)] = Field(
        default="",
        description="The variable's value, which everybody may read who may read this resource. Default: empty.",
    )
    value_from: ValueFrom | None = Field(
        default=None,
        description="Where the value comes from instead of value: passwords and tokens belong into a Secret. "
        "Default: value counts.",
    )


class Node(Model):
    """One ROS 2 node of the application."""

    name: NodeName = Field(description="The node's name without its namespace, e.g. controller_server.")
    placement: Literal["Robot", "Cloud", "Duplicated"] = Field(
        description="Where it runs: Robot, Cloud, or Duplicated (a replica on each side, one acts)."
    )
    core: bool = Field(
        default=False,
        description="Whether the robot must not move without it: when it is not active, the driver is "
        "inhibited. A Cloud node cannot be core. Default false.",
    )
    lifecycle: bool = Field(
        default=True,
        description="Whether it is a managed (lifecycle) node. A Duplicated node without a lifecycle runs on both "
        "sides all the time (Hot), which costs its CPU twice. Default true.",
    )
    standby: Standby = Field(
        default_factory=Standby,
        description="What its replica on the side that does not act does. Only for Duplicated nodes.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )
    run: Run | None = Field(default=None, description="How it is started. Without it, something else starts the node.")
    image: ImageName | None = Field(
        default=None,
        description="The container image of its replica in the cloud, e.g. registry.example/nav2:1. A cluster needs "
        "it, or build, for nodes that run in the cloud.",
    )
    build: NodeBuild | None = Field(
        default=None,
        description="What that image is built from in the cluster, instead of image; it is pushed to "
        "spec.cloud.registry. Default: nothing is built.",
    )
    image_pull_policy: Literal["Always", "IfNotPresent", "Never"] | None = Field(
        default=None,
        description="When the image is fetched: Always, IfNotPresent or Never. Default: as Kubernetes does, Always "
        "for the tag latest and IfNotPresent otherwise.",
    )
    env: tuple[EnvironmentVariable, ...] = Field(
        default=(),
        max_length=64,
        description="Environment variables of its replica in the cloud, at most 64. Default: none.",
        json_schema_extra=map_list("name"),
    )
    resources: Resources = Field(
        default_factory=Resources, description="Computing resources of its replica in the cloud."
    )
    node_selector: dict[LabelKey, LabelValue] = Field(
        default_factory=dict,
        max_length=32,
        description="Labels of the cluster's nodes on which its replica may run, added to those of spec.cloud. "
        "Default: none.",
    )
    runtime_class_name: ObjectName | None = Field(
        default=None,
        description="The RuntimeClass of its replica in the cloud, e.g. nvidia. Default: the cluster's own.",
    )
    pod_spec: PodSpec = Field(
        default_factory=dict,
        description="The same as podSpec of spec.cloud for the pod of its replica alone, laid over it; its "
        "container is called node. Default: none.",
    )
    outputs: tuple[Output, ...] = Field(
        default=(),
        max_length=16,
        description="The topics it publishes for other nodes, at most 16. Default: none.",
        json_schema_extra=map_list("topic"),
    )
    services: tuple[Service, ...] = Field(
        default=(),
        max_length=16,
        description="The services it offers to nodes on the robot that are not Duplicated, at most 16. Default: none.",
        json_schema_extra=map_list("name"),
    )
    actions: tuple[Action, ...] = Field(
        default=(),
        max_length=16,
        description="The actions it offers to nodes on the robot that are not Duplicated, at most 16. Default: none.",
        json_schema_extra=map_list("name"),
    )
    uses: Uses = Field(default_factory=Uses, description="The services and actions that it calls.")
    replicas: Annotated[int, Field(ge=1, le=MOST_PODS)] | None = Field(
        default=None,
        description="How many pods share the calls of its services, from 1 to 32: a call goes to the one with the "
        "fewest open calls. Only for nodes with placement Cloud, lifecycle false, and services alone. Default: one "
        "pod, which is replaced and never joined by another.",
    )
    max_replicas: Annotated[int, Field(ge=1, le=MOST_PODS)] | None = Field(
        default=None,
        description="To how many pods an autoscaler (HorizontalPodAutoscaler, KEDA) may scale the node's Deployment, "
        "from 1 to 32; below replicas it is never scaled but to none while the robot is away. Default: replicas, the "
        "number is fixed.",
    )
    state: tuple[State, ...] = Field(
        default=(),
        max_length=8,
        description="What its replica on the side that does not act gets to know all the time, at most 8 entries. "
        "Default: nothing.",
    )

    @property
    def offered(self) -> tuple[Service | Action, ...]:
        """The services and actions that it offers."""
        return (*self.services, *self.actions)

    @property
    def most_pods(self) -> int:
        """The largest number of pods that share its calls; 0: it has one pod that shares none."""
        return max(self.replicas or 0, self.max_replicas or 0)

    @property
    def called(self) -> tuple[UsedService | UsedAction, ...]:
        """The services and actions that it calls."""
        return (*self.uses.services, *self.uses.actions)

    @property
    def named_state(self) -> tuple[tuple[str, State], ...]:
        """The entries of state with names of their own: `amcl_1` is the first one of the node amcl."""
        return tuple((f"{self.name}_{number}", state) for number, state in enumerate(self.state, start=1))

    @property
    def duplicated(self) -> bool:
        """Whether there is a replica on each side."""
        return self.placement == "Duplicated"

    @property
    def in_cloud(self) -> bool:
        """Whether a replica runs in the cloud."""
        return self.placement != "Robot"
