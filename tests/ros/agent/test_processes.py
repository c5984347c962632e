"""Every process of both agents is killed and stopped, alone, while the cloud acts and while the robot acts."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.ears import wait_until
from tests.ros.agent.harness import PATIENCE_S, PROCESSES, World
from tests.ros.agent.passage import UNDISTURBED_S, longest_gap_s

EACH = [(side, process) for side, processes in PROCESSES.items() for process in processes]
STOPPED_S = 1.0
SLICE_S, STANDS_S = 0.010, 0.055
"""Control takes a step later than 50 ms for a pause of its own."""
UNNOTICED_S = 0.105
"""A process that stands still for longer than 0.12 s knows of it, and leaves out what has waited for it."""
SLACK_S = 0.5
"""The collector changes over first, then control hears of it and says so; a fraction of what a start takes."""
GAP_LIMIT_S = 5.0
RESTART_LIMIT_S = 5.0
"""The aim is 0.5 s; the bound leaves room for a machine that does other things as well."""


def await_restart(world: World, side: str, process: str, dead: int) -> None:
    world.until(lambda: world.pid(side, process) not in (0, dead), f"{side} {process} is started again")


@pytest.mark.core
@pytest.mark.parametrize(("side", "process"), EACH)
def test_a_killed_process_is_replaced_and_the_cloud_acts_again(world: World, side: str, process: str) -> None:
    dead = world.pid(side, process)
    at_s = world.kill(side, process)
    await_restart(world, side, process, dead)
    world.until(lambda: world.arrivals[-1].t_s > at_s + 0.5, "commands flow")
    world.goes_to("cloud")
    assert longest_gap_s(world.arrivals, at_s) < GAP_LIMIT_S


@pytest.mark.parametrize(("side", "process"), EACH)
def test_a_killed_process_does_not_disturb_the_robot_that_acts(world: World, side: str, process: str) -> None:
    world.place("robot", stay=True)
    since, dead = len(world.arrivals), world.pid(side, process)
    at_s = world.kill(side, process)
    await_restart(world, side, process, dead)
    restarted_s = now_s() - at_s
    world.until(lambda: world.arrivals[-1].t_s > at_s + 0.5, "commands flow")
    # If the commands waited for the new process, there would be none until it has come.
    limit_s = RESTART_LIMIT_S if process == "collector" else max(0.5, restarted_s)
    assert longest_gap_s(world.arrivals, at_s) < limit_s
    assert {a.site for a in world.arrivals[since:]} == {"robot"}


@pytest.mark.parametrize(("side", "process"), EACH)
def test_nothing_stale_passes_after_a_process_was_stopped_while_the_cloud_acted(
    world: World, side: str, process: str
) -> None:
    at_s, stopped = now_s(), world.pid(side, process)
    world.signal(side, process, signal.SIGSTOP)
    wait_until(lambda: now_s() > at_s + STOPPED_S, STOPPED_S + 1)
    world.signal(side, process, signal.SIGCONT)
    world.until(lambda: world.arrivals[-1].t_s > at_s + STOPPED_S + 0.3, "commands flow")
    assert longest_gap_s(world.arrivals, at_s) < STOPPED_S + GAP_LIMIT_S
    world.goes_to("cloud")
    assert world.pid(side, process) == stopped
    assert max(a.age_s for a in world.arrivals if a.t_s > at_s) < 0.5


def test_a_command_is_as_old_as_it_is_that_waited_for_the_egress_for_less_than_a_pause(
    build: Callable[..., World],
) -> None:
    world = build(both={"max_command_age_ms": 90.0})
    world.start()

    def refused() -> bool:
        """Whether the collector has refused one, after another short stop of the cloud's data process."""
        since = len(world.arrivals)
        world.signal("cloud", "data", signal.SIGSTOP)
        time.sleep(UNNOTICED_S)
        world.signal("cloud", "data", signal.SIGCONT)
        world.until(lambda: any(a.site == "cloud" for a in world.arrivals[since:]), "the cloud is heard again")
        return int(world.ear.diagnostics["data"].values.get("command.cloud.Stale", "0")) > 0

    world.until(refused, "one is too old")
    world.check()


@pytest.mark.parametrize("process", PROCESSES["robot"])
def test_nothing_stale_passes_after_a_process_was_stopped_while_the_robot_acted(world: World, process: str) -> None:
    world.place("robot", stay=True)
    at_s = now_s()
    world.signal("robot", process, signal.SIGSTOP)
    wait_until(lambda: now_s() > at_s + STOPPED_S, STOPPED_S + 1)
    world.signal("robot", process, signal.SIGCONT)
    world.until(lambda: world.arrivals[-1].t_s > at_s + STOPPED_S + 0.3, "commands flow")
    limit_s = STOPPED_S + GAP_LIMIT_S if process == "collector" else STOPPED_S
    assert longest_gap_s(world.arrivals, at_s) < limit_s
    assert max(a.age_s for a in world.arrivals if a.t_s > at_s) < 0.4


@contextlib.contextmanager
def in_slices(world: World, side: str, process: str) -> Iterator[None]:
    """Lets a process run and stand still, again and again."""
    done, pid = threading.Event(), world.pid(side, process)

    def slice_it() -> None:
        with contextlib.suppress(ProcessLookupError):
            while not done.wait(SLICE_S):
                os.kill(pid, signal.SIGSTOP)
                done.wait(STANDS_S)
                os.kill(pid, signal.SIGCONT)

    thread = threading.Thread(target=slice_it)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def test_a_control_that_gets_its_processor_in_slices_still_leaves_a_cloud_that_fell_silent(world: World) -> None:
    world.place("cloud", stay=True)
    with in_slices(world, "robot", "control"):
        time.sleep(4 * STANDS_S)  # not so long that control leaves because of the slices alone
        world.signal("cloud", "data", signal.SIGSTOP)
        world.passes("robot")
        world.signal("cloud", "data", signal.SIGCONT)


@pytest.mark.parametrize("side", PROCESSES)
def test_processes_that_hang_are_ended_and_replaced_counted_and_reported_and_the_cloud_acts_again(
    world: World, side: str
) -> None:
    before = {process: world.pid(side, process) for process in PROCESSES[side]}
    for process in before:
        world.signal(side, process, signal.SIGSTOP)
    for process, pid in before.items():
        await_restart(world, side, process, pid)
    if side == "robot":
        world.begun_s.append(now_s())
    world.goes_to("cloud")
    ear = world.ear if side == "robot" else world.cloud_ear()

    def counted() -> bool:
        values = ear.diagnostics["data"].values
        return all(int(values[f"process.{name}.hangs"]) >= 1 for name in before) and "ProcessHung" in values

    world.until(counted, "diagnostics name every process that hung")


@pytest.mark.parametrize("side", PROCESSES)
@pytest.mark.parametrize("acting", ["cloud", "robot"])
def test_a_killed_supervisor_disturbs_nothing_and_the_next_one_starts_anew(
    world: World, side: str, acting: str
) -> None:
    world.place(acting, stay=True)
    before = {process: world.pid(side, process) for process in PROCESSES[side]}
    at_s = world.kill(side, "supervisor")
    world.agents[side].wait(PATIENCE_S)
    world.passes(acting, 15)
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    world.start_agent(side)
    for process, pid in before.items():
        await_restart(world, side, process, pid)
    world.override("Auto")
    world.goes_to("cloud")


def test_the_robots_output_passes_when_every_other_process_of_the_agent_is_dead(world: World) -> None:
    world.place("robot", stay=True)
    at_s = world.kill("robot", "supervisor")
    for process in ("control", "pulse", "data"):
        world.kill("robot", process)
    world.passes("robot", 30)
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    world.agents["robot"].wait(PATIENCE_S)


def test_a_killed_agent_starts_anew_at_once_and_the_old_lease_is_worth_nothing(world: World) -> None:
    old = world.placed[-1].control
    world.kill_agent("robot")
    at_s = now_s()
    world.start_agent("robot")
    world.until(
        lambda: world.placed[-1].control != old and world.site == "cloud", "the new agent puts the cloud in charge"
    )
    announced_s = next(p.t_s for p in world.placed if p.control != old and p.t_s > at_s)
    world.until(lambda: any(a.t_s > announced_s and a.site == "cloud" for a in world.arrivals), "the cloud passes")
    first_s = next(a.t_s for a in world.arrivals if a.t_s > at_s and a.site == "cloud")
    assert first_s > announced_s - SLACK_S, "the cloud passed before the new agent had given it a lease of its own"


def test_the_cloud_is_used_again_after_its_whole_agent_was_killed(world: World) -> None:
    world.kill_agent("cloud")
    world.goes_to("robot")
    world.start_agent("cloud")
    world.goes_to("cloud")
