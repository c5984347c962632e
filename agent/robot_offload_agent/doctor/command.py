"""`robot-offload-agent doctor --params FILE`: looks for problems on this robot and names the next step."""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from robot_offload_agent.doctor import graph, machine, network
from robot_offload_agent.doctor.findings import Check, Finding, Level, as_json, as_text, exit_code
from robot_offload_agent.errors import AgentError, ConfigurationError
from robot_offload_agent.settings.parameters import Configuration, load
from robot_offload_core.fence.token import Site

EPILOG = """\
examples:
  robot-offload-agent doctor --params /etc/robot-offload/wheelchair/agent.yaml
  robot-offload-agent doctor --params agent.yaml --json

It changes nothing, and may run beside the agent. exit codes: 0 nothing stands in the way, 1 an error was found,
2 bad configuration
"""


def main(words: list[str]) -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="robot-offload-agent doctor", description=__doc__, epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--params", type=Path, required=True, metavar="FILE", help="the robot's agent.yaml")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    parser.add_argument("--no-network", action="store_true", help="dial nobody")
    options = parser.parse_args(words)
    try:
        configuration = load(options.params)
        if configuration.side is not Site.ROBOT:
            raise ConfigurationError("parameter side: doctor looks at robots; the file is for the cloud")
        findings = list(examine(configuration, dial=not options.no_network))
    except AgentError as error:
        for line in str(error).splitlines():
            sys.stderr.write(f"robot-offload-agent: {line}\n")
        return error.exit_code
    sys.stdout.write((as_json(findings) if options.json else as_text(findings)) + "\n")
    return exit_code(findings)


def examine(configuration: Configuration, *, dial: bool) -> Iterator[Finding]:
    """Look at everything; take some seconds. Raise ConfigurationError for values with which no link can be opened."""
    yield from _versions()
    yield from machine.judge(machine.look(), configuration)
    yield from machine.certificates(configuration)
    if dial:
        own = (configuration["link.certificate"], configuration["link.private_key"])
        yield from network.judge([(each, network.reach(each, own)) for each in network.endpoints(configuration)])
    try:
        # Late: without a sourced ROS 2 all other checks still run.
        from robot_offload_agent.ros.interfaces import any_type  # noqa: PLC0415
    except ImportError as error:
        yield Finding(Check.MESSAGE_TYPES, Level.UNKNOWN, str(error), "Source ROS 2 in this shell.")
    else:
        yield from graph.missing_types(configuration, any_type)
    yield from graph.judge(graph.look(configuration), configuration)


def _versions() -> Iterator[Finding]:
    """Yield the versions here, to be compared with the cloud's image; only programs of one version work together."""
    found = [f"Python {platform.python_version()}"]
    for name in ("robot-offload-agent", "robot-offload-core", "eclipse-zenoh"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            step = "pip install 'eclipse-zenoh>=1.10,<2'" if name == "eclipse-zenoh" else "Install the agent anew."
            yield Finding(Check.VERSIONS, Level.WARNING, f"{name} is not installed as a package", step)
    yield Finding(Check.VERSIONS, Level.OK, ", ".join(found))
