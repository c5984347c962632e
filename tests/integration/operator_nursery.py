"""Run as a program: forks an operator for each order on the standard input (see operator_process.Nursery)."""

# ruff: noqa: T201 - the answers go to the standard output
from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

from robot_offload import handlers as running


def main() -> None:
    alive: set[int] = set()
    for line in sys.stdin:
        order = json.loads(line)
        if "poll" in order:
            pid, status = os.waitpid(order["poll"], os.WNOHANG)
            alive.discard(pid)
            print(os.waitstatus_to_exitcode(status) if pid else "running", flush=True)
            continue
        pid = os.fork()
        if pid == 0:
            _become_operator(Path(order["log"]), order["environment"])
        alive.add(pid)
        print(pid, flush=True)
    for pid in alive:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def _become_operator(log: Path, environment: dict[str, str]) -> None:
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.environ.clear()
    os.environ.update(environment)
    code = 1
    try:
        code = running.main()
    finally:
        os._exit(code)


if __name__ == "__main__":
    main()
