"""A supervisor with trivial children, to be run as a process by test_supervisor.

    python -m tests.unit.agent.process.supervised FOLDER NAME=WHAT...

WHAT: `sleep` stays; `die` ends at once; `deaf` stays and ignores SIGTERM; `error` fails with a message for a person;
`late` dies once and fails with a message in its second life.
"""

import logging
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from robot_offload_agent.errors import AgentError, StartError
from robot_offload_agent.process import supervisor
from robot_offload_agent.process.supervisor import Child, Supervisor


def behave(folder: Path, name: str, what: str) -> None:
    with (folder / f"{name}.lives").open("a") as lives:
        lives.write("x")
    if what == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if what == "error" or (what == "late" and (folder / f"{name}.lives").stat().st_size > 1):
        raise StartError(f"{name} cannot start: move the other one away")
    while what in ("sleep", "deaf"):
        time.sleep(1)


def main(folder: Path, words: list[str]) -> int:
    logging.basicConfig(level=logging.INFO, stream=sys.stderr)
    supervisor.STOP_GRACE_S = 0.5
    children = []
    for word in words:
        name, _, what = word.partition("=")
        run: Callable[[], None] = partial(behave, folder, name, what)
        children.append(Child(name, run))
    try:
        return Supervisor(folder, "ro-test", children).run()
    except AgentError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
