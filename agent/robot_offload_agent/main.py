"""`robot-offload-agent robot|cloud --params FILE`: the agent of one side. Beside it: `doctor`, `record`, `audit`."""

from __future__ import annotations

import argparse
import gc
import logging
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from robot_offload_agent.certificates.wallet import with_own_certificate
from robot_offload_agent.errors import AgentError, ConfigurationError
from robot_offload_agent.runtime.release import release
from robot_offload_agent.settings.parameters import Configuration, load
from robot_offload_core.fence.token import Site

COLLECTOR_HUNG_S = 3.0
"""Without the collector no output passes and the robot stands still, so its limit is shorter than the others'."""

Programs = dict[str, Callable[[Configuration], None]]
"""The task of each process, by its name."""

EPILOG = """\
examples:
  robot-offload-agent robot --params robot.yaml     on the robot, with the file of the bundle
  robot-offload-agent robot --params robot.yaml --check   only says whether the file is good
  robot-offload-agent doctor --params robot.yaml    looks for what would bite on this robot
  robot-offload-agent record --params robot.yaml --output run.mcap   records until Ctrl-C, for Foxglove or rosbag2
  robot-offload-agent audit verify --params robot.yaml     was the trail of pins, switches and settings altered?
  robot-offload-agent robot --params robot.yaml --record link.csv   for robot-offload simulate --trace link.csv

exit codes: 0 ended by a signal, 2 bad configuration, 3 this identity runs here already, 4 the ROS graph forbids it
"""


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = argparse.ArgumentParser(
        prog="robot-offload-agent", description=__doc__, epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    result.add_argument("--version", action="version", version=f"%(prog)s {release()}")
    result.add_argument("side", choices=[s.value for s in Site], help="which side this is")
    result.add_argument("--params", type=Path, required=True, metavar="FILE", help="ROS 2 parameter file")
    result.add_argument("--record", type=Path, metavar="FILE", help="record the link (robot only), CSV t_s,rtt_ms")
    result.add_argument("--check", action="store_true", help="check the file and stop")
    result.add_argument("--log-level", default="info", choices=("debug", "info", "warning", "error"))
    return result


def main(arguments: list[str] | None = None) -> int:
    """Run the agent and return the exit code. Arguments behind `--ros-args` (given by launch) are ignored."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "--ros-args" in words:
        words = words[: words.index("--ros-args")]
    if words[:1] == ["doctor"]:
        from robot_offload_agent.doctor.command import main as doctor  # noqa: PLC0415 - the agent goes without it

        return doctor(words[1:])
    if words[:1] == ["audit"]:
        from robot_offload_agent.record.audit_command import main as audit  # noqa: PLC0415 - as above

        return audit(words[1:])
    if words[:1] == ["record"]:
        from robot_offload_agent.record.mcap.command import main as record  # noqa: PLC0415 - the agent goes without it

        return record(words[1:])
    options = parser().parse_args(words)
    logging.basicConfig(
        level=options.log_level.upper(), stream=sys.stderr,
        format=f"%(asctime)s.%(msecs)03d %(levelname)s {options.side}.%(module)s: %(message)s", datefmt="%H:%M:%S",
    )  # fmt: skip
    try:
        configuration = load(options.params)
        if configuration["side"] != options.side:
            raise ConfigurationError(f"parameter side: the file is for the {configuration['side']}")
        if options.record is not None:
            configuration = recording(configuration, options.record)
        if not options.check:
            configuration = with_own_certificate(configuration)
        check_link(configuration)
        return 0 if options.check else supervise(configuration)
    except AgentError as error:
        for line in str(error).splitlines():
            sys.stderr.write(f"robot-offload-agent: {line}\n")
        return error.exit_code


def recording(configuration: Configuration, file: Path) -> Configuration:
    """Return the configuration with a file to record the link to; raise ConfigurationError if that is not possible."""
    if configuration.side is not Site.ROBOT:
        raise ConfigurationError("--record: only the robot's agent records the link; leave it out in the cloud")
    if not file.absolute().parent.is_dir():
        raise ConfigurationError(f"--record: the folder {file.absolute().parent} does not exist; make it first")
    return replace(configuration, values={**configuration.values, "record_file": str(file.absolute())})


def supervise(configuration: Configuration) -> int:
    """Import everything once, then fork the processes and supervise them."""
    # Late, so that a wrong parameter file is reported before half a second of imports.
    from robot_offload_agent.ros.context import run_until_ended  # noqa: PLC0415
    from robot_offload_agent.ros.preload import preload  # noqa: PLC0415
    from robot_offload_agent.runtime import thrift  # noqa: PLC0415
    from robot_offload_agent.runtime.child import HUNG_S, Child  # noqa: PLC0415
    from robot_offload_agent.runtime.supervisor import Supervisor  # noqa: PLC0415

    # Fast DDS in shared memory waits for one to three seconds on the ports of a process that was killed; a collector
    # started again must pass messages sooner. The user's nodes keep their transports: they use UDP as well.
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    thrift.save()
    robot = configuration.side is Site.ROBOT
    runs = programs_of_robot(configuration) if robot else programs_of_cloud(configuration)
    preload(configuration)
    gc.collect()
    children = [
        Child(name, partial(run_until_ended, run, configuration), COLLECTOR_HUNG_S if name == "collector" else HUNG_S)
        for name, run in runs.items()
    ]
    prefix = "ro-robot" if robot else "ro-cloud"
    identity = f"{configuration['uid']}-{configuration['side']}"
    return Supervisor(configuration.runtime_dir, prefix, children, identity).run()


def programs_of_robot(configuration: Configuration) -> Programs:
    """Import what the robot's processes need, and nothing else: each of them carries every import."""
    from robot_offload_agent.collector import process as collector  # noqa: PLC0415 - see supervise
    from robot_offload_agent.control import robot as control  # noqa: PLC0415
    from robot_offload_agent.data import robot as data  # noqa: PLC0415
    from robot_offload_agent.pulse import process as pulse  # noqa: PLC0415

    found: Programs = {"collector": collector.run, "pulse": pulse.run, "control": control.run, "data": data.run}
    if configuration["record.switches"]:
        found |= recorder()
    if configuration.relay_plan() is not None:
        from robot_offload_agent.relay import robot as relay  # noqa: PLC0415

        found["relay"] = relay.run
    return found


def programs_of_cloud(configuration: Configuration) -> Programs:
    """Import what the cloud's processes need, and nothing else."""
    from robot_offload_agent.control import cloud as control  # noqa: PLC0415 - see supervise
    from robot_offload_agent.data import cloud as data  # noqa: PLC0415
    from robot_offload_agent.pulse import process as pulse  # noqa: PLC0415

    found: Programs = {"pulse": pulse.run, "control": control.run, "data": data.run}
    if configuration.relay_plan() is not None:
        from robot_offload_agent.relay import cloud as relay  # noqa: PLC0415

        found["relay"] = relay.run
    return found


def recorder() -> Programs:
    """Return the process that records changeovers; none if its library is missing, which is not fatal."""
    from robot_offload_agent.record.mcap import mcap_file, process  # noqa: PLC0415 - see supervise

    if mcap_file.installed():
        return {"record": process.run}
    logging.getLogger(__name__).warning("No changeover is recorded: %s reason=RecordingFailed", mcap_file.MISSING)
    return {}


def check_link(configuration: Configuration) -> None:
    """Check endpoints and certificates; raise ConfigurationError."""
    from robot_offload_agent.link import choice  # noqa: PLC0415 - see supervise

    choice.check_link(configuration)


if __name__ == "__main__":
    sys.exit(main())
