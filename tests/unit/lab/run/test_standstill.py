"""A machine that stood still is said to have done so, whether it was busy or suspended."""

from __future__ import annotations

import signal
import time

from robot_offload_lab.run.standstill import STEP_S, Standstill

LOOKED_S = 3.0
"""Until the process looks for sure; it starts in a tenth of that."""


class Clocks:
    def __init__(self) -> None:
        self.running_s = self.passing_s = 100.0

    def step(self, ran_s: float, suspended_s: float = 0.0) -> None:
        self.running_s += ran_s
        self.passing_s += ran_s + suspended_s


def watched(*steps: tuple[float, float]) -> str:
    clocks = Clocks()
    watch = Standstill(lambda: clocks.running_s, lambda: clocks.passing_s)
    for ran_s, suspended_s in steps:
        clocks.step(ran_s, suspended_s)
        watch.look()
    return watch.sentence()


def test_a_machine_that_ran_is_not_mentioned() -> None:
    assert watched(*[(STEP_S, 0.0)] * 5, (0.09, 0.0)) == ""


def test_a_busy_machine_is_said_to_have_stood_still() -> None:
    assert watched((STEP_S, 0.0), (0.31, 0.0), (STEP_S, 0.0), (0.16, 0.0)).startswith(
        "This machine stood still 2 times, for up to 300 ms: silence"
    )


def test_a_suspended_machine_is_told_from_a_busy_one_by_its_two_clocks() -> None:
    text = watched((STEP_S, 0.0), (STEP_S, 5.1))
    assert text.startswith("This machine stood still once, for up to 5100 ms (5.0 s of it suspended)")


def test_a_process_that_stood_still_is_noticed_by_the_one_that_looks() -> None:
    with Standstill() as machine:
        assert machine._process is not None
        time.sleep(LOOKED_S)
        machine._process.send_signal(signal.SIGSTOP)
        time.sleep(0.4)
        machine._process.send_signal(signal.SIGCONT)
        time.sleep(0.1)
    assert machine._process.poll() == 0
    assert max(machine.lengths_s) >= 0.3
    assert "This machine stood still" in machine.sentence()


def test_a_process_that_was_killed_says_nothing() -> None:
    with Standstill() as machine:
        assert machine._process is not None
        machine._process.kill()
    assert machine.sentence() == ""
