"""`robot-offload-tunnel --params FILE`: one end of the tunnel between the two DDS Routers."""

from __future__ import annotations

import argparse
import asyncio
import logging
import signal
import sys
from contextlib import suppress
from pathlib import Path

from robot_offload_agent.errors import AgentError
from robot_offload_agent.runtime.realtime import PULSE_PRIORITY, request
from robot_offload_agent.tunnel.configuration import TunnelConfiguration, read
from robot_offload_agent.tunnel.ends import Tunnel, context

log = logging.getLogger(__name__)


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = argparse.ArgumentParser(
        prog="robot-offload-tunnel", description=__doc__, epilog="exit codes: 0 ended by a signal, 2 bad configuration"
    )
    result.add_argument("--params", type=Path, required=True, metavar="FILE", help="the tunnel's file, tunnel.yaml")
    result.add_argument("--check", action="store_true", help="check the file and stop")
    return result


def main(arguments: list[str] | None = None) -> int:
    """Run the tunnel and return the exit code."""
    options = parser().parse_args(arguments)
    logging.basicConfig(
        level="INFO", stream=sys.stderr, format="%(asctime)s.%(msecs)03d %(levelname)s tunnel: %(message)s",
        datefmt="%H:%M:%S",
    )  # fmt: skip
    try:
        configuration = read(options.params)
        context(configuration)
        if not options.check:
            asyncio.run(_run(configuration))
    except AgentError as error:
        sys.stderr.write(f"robot-offload-tunnel: {error}\n")
        return error.exit_code
    return 0


async def _run(configuration: TunnelConfiguration) -> None:
    task = asyncio.create_task(Tunnel(configuration).run())
    for word in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(word, task.cancel)
    log.info("Started priority=%s", request(configuration.realtime, PULSE_PRIORITY - 1))
    with suppress(asyncio.CancelledError):
        await task


if __name__ == "__main__":
    sys.exit(main())
