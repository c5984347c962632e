"""A supervisor with trivial children, to be run as a process by test_supervisor.

    python -m tests.unit.agent.runtime.supervised FOLDER IDENTITY NAME=WHAT...

WHAT: `sleep` stays and gives signs of life; `hang` gives one and stays; `half` has a thread that hangs; `die` ends at
once; `break` ends at once for a broken invariant; `deaf` stays and ignores SIGTERM; `error` fails with a message for
a person; `miss` stays and says all the time that `one` has not been heard;
`late` dies once and fails with a message in its second life; `control` writes down what the supervisor says
of the others.
"""

import logging
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from robot_offload_agent.errors import AgentError, StartError
from robot_offload_agent.runtime import supervisor
from robot_offload_agent.runtime.beacon import Beacon
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.child import Child
from robot_offload_agent.runtime.supervisor import Supervisor
from robot_offload_core.words.checks import require
from robot_offload_core.words.messages import Unheard

PATIENT_S = 60.0
HUNG_S = {"one": float(os.environ.get("ONE_HUNG_S", PATIENT_S))}
"""The tests are about `one`, and few of them about its silence; a busy machine must not make the others hang."""


def behave(folder: Path, name: str, what: str) -> None:
    with (folder / f"{name}.lives").open("a") as lives:
        lives.write("x")
    if what == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if what == "error" or (what == "late" and (folder / f"{name}.lives").stat().st_size > 1):
        raise StartError(f"{name} cannot start: move the other one away")
    if what == "break":
        require("machine", "an event", (False, "what must hold"))
    bus = Bus(folder, name)
    beacon = Beacon(bus, "main", *(["other"] if what == "half" else []))
    beacon.sign("main")
    while what in ("sleep", "deaf", "hang", "half", "control", "miss"):
        if what != "hang":
            beacon.sign("main")
        if what == "miss":
            bus.send("supervisor", Unheard("one", 10.0))
        while (message := bus.receive()) is not None:
            (folder / f"{name}.heard").write_text(str(message))
        time.sleep(0.1)


def main(folder: Path, name: str, words: list[str]) -> int:
    logging.basicConfig(level=logging.INFO, stream=sys.stderr)
    supervisor.STOP_GRACE_S = 0.5
    children = []
    for word in words:
        child, _, what = word.partition("=")
        run: Callable[[], None] = partial(behave, folder, child, what)
        children.append(Child(child, run, HUNG_S.get(child, PATIENT_S)))
    try:
        return Supervisor(folder, "ro-test", children, name).run()
    except AgentError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], sys.argv[3:]))
