"""`robot-offload dockerfile`: the Dockerfile of a ROS 2 node's image, or of an image with the agent.

The options are declared by the features of `robot_offload.images`; `build` has the same ones.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from robot_offload.api.files import load, read_text
from robot_offload.api.strict_yaml import YamlError
from robot_offload.api.strict_yaml import parse as parse_yaml
from robot_offload.cli.app import example_text
from robot_offload.cli.own_images import default_images
from robot_offload.decide.build_specs import from_git
from robot_offload.errors import InputError
from robot_offload.images.dockerfiles import check, dockerfile
from robot_offload.images.features import Flag
from robot_offload.images.flags import ALL_FLAGS, node_spec, option_findings, overlay_spec
from robot_offload.images.spec import BuildSpec, OverlaySpec

EXAMPLES: Final = (
    "robot-offload dockerfile --git https://git.example/robot.git --ref v1.2 --path src/controller \\",
    "    --package controller --executable controller_server --distro jazzy > Dockerfile",
    "robot-offload dockerfile --workspace src --package bringup --launch robot.launch.py --rmw rmw_cyclonedds_cpp",
    "robot-offload dockerfile --spec build.yaml --output Dockerfile",
    "robot-offload dockerfile wheelchair.yaml --node controller",
    "robot-offload dockerfile --agent --from registry.example/robot/interfaces:7 --setup ws/install/setup.bash",
    "robot-offload dockerfile --agent --interfaces nav2_msgs",
)
_KINDS: Final[Mapping[str, Any]] = {"text": str | None, "texts": list[str] | None, "number": int | None, "switch": bool}

Agent = Annotated[bool, typer.Option("--agent", help="An image with the agent and your message packages.")]
SpecFile = Annotated[
    Path | None,
    typer.Option("--spec", metavar="FILE", help="YAML file with the fields of a `build:` block; options win over it."),
]


ResourceFile = Annotated[
    Path | None,
    typer.Argument(metavar="[FILE]", help="YAML file with a RobotOffload: builds what its node's `build:` block says."),
]
_NODE: Final = "--node"


@dataclass(frozen=True)
class Options:
    """All options that describe the image.

    Attributes:
        agent: whether it is an image with the agent.
        file: with the fields of a `build:` block.
        given: the features' options.
        resource: file with the RobotOffload to which the node belongs.
    """

    agent: bool
    file: Path | None
    given: Mapping[str, Any]
    resource: Path | None = None

    def spec(self) -> BuildSpec | OverlaySpec:
        """Return the specification.

        Raises:
            InputError: one of the options cannot be used.
        """
        if self.resource is not None:
            if self.agent or self.file:
                raise InputError(f"{self.resource}: a file with a RobotOffload goes with neither --agent nor --spec")
            # Here the option names a node of the resource, which the image need not know.
            options = {**self.given, _NODE: None}
            return node_spec(options, _block_of_node(self.resource, self.given.get(_NODE)), str(self.resource))
        if self.agent:
            if self.file:
                raise InputError("--spec: does not go with --agent")
            return overlay_spec(self.given, default_images().agent)
        return node_spec(self.given, _block(self.file), str(self.file or "options"))


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("dockerfile", epilog=example_text(EXAMPLES))(with_flags(dockerfile_command))


def dockerfile_command(
    *,
    file: ResourceFile = None,
    agent: Agent = False,
    spec: SpecFile = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="File to write. Default: standard output.")
    ] = None,
    **given: Any,
) -> None:
    """Print a Dockerfile for a ROS 2 node: small, cached, not root, the same for the same options.

    The source is a git repository (--git), folders of a workspace (--workspace) or a .repos file (--repos); or FILE
    says it all: the `build:` block of the node --node, which a cluster builds from a checked-out copy. Build it
    with `robot-offload build` and the same options, or with docker, podman or buildah yourself. Ends with 2 when an
    option cannot be used.
    """
    text = checked_text(Options(agent, spec, by_option(given), file))
    if output is None:
        typer.echo(text, nl=False)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror}") from error


def checked_text(options: Options, spec: BuildSpec | OverlaySpec | None = None) -> str:
    """Return the Dockerfile; warnings go to standard error.

    Raises:
        InputError: the options, or a rule between them, are wrong.
    """
    spec = spec or options.spec()
    findings = option_findings(check(spec), options.given)
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        raise InputError("\n".join(finding.line() for finding in errors))
    for finding in findings:
        typer.echo(f"warning: {finding.line()}", err=True)
    return dockerfile(spec)


def with_flags(function: Callable[..., None]) -> Callable[..., None]:
    """Add the features' options to those of `function`, which receives them under the names of `by_option`."""
    own = inspect.signature(function, eval_str=True)
    parameters = [parameter for parameter in own.parameters.values() if parameter.kind is parameter.KEYWORD_ONLY]
    parameters += [_parameter(flag) for flag in ALL_FLAGS]

    def command(**values: Any) -> None:
        function(**values)

    command.__doc__ = function.__doc__
    command.__name__ = function.__name__
    command.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command


def by_option(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by option instead of by parameter name."""
    return {flag.option: given.get(_name(flag)) for flag in ALL_FLAGS}


def _name(flag: Flag) -> str:
    return "flag_" + flag.option.removeprefix("--").replace("-", "_")


def _parameter(flag: Flag) -> inspect.Parameter:
    option = typer.Option(flag.option, help=flag.help, metavar=None if flag.kind == "switch" else flag.metavar)
    return inspect.Parameter(
        _name(flag),
        inspect.Parameter.KEYWORD_ONLY,
        default=False if flag.kind == "switch" else None,
        annotation=Annotated[_KINDS[flag.kind], option],
    )


def _block_of_node(file: Path, name: str | None) -> dict[str, Any]:
    """Return the `build:` block of a node, completed from the rest of its RobotOffload."""
    spec = load(file).spec
    built = {node.name: node for node in spec.nodes if node.build is not None}
    if not built:
        raise InputError(f"{file}: no node has a build block; add one, or use options")
    if name is None and len(built) > 1:
        raise InputError(f"{file}: --node: which one? It has {', '.join(built)}")
    node = built.get(name or next(iter(built)))
    if node is None or node.build is None:
        raise InputError(f"{file}: --node: no node {name!r} with a build block; it has {', '.join(built)}")
    return from_git(spec, node, node.build).model_dump(mode="json", by_alias=True, exclude_none=True)


def _block(file: Path | None) -> Mapping[str, Any]:
    """Return the `build:` block of a file, with or without the key `build`; empty without a file."""
    if file is None:
        return {}
    try:
        value = parse_yaml(read_text(file))
    except YamlError as error:
        raise InputError(f"{file}: {error.position}: {error.problem}") from error
    if isinstance(value, Mapping) and set(value) == {"build"}:
        value = value["build"]
    if not isinstance(value, Mapping):
        raise InputError(f"{file}: must be a mapping with the fields of a `build:` block")
    return value
