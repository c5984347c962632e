"""An agent that only observes, and hosts whose clocks differ."""

import subprocess
from collections.abc import Callable
from pathlib import Path

from tests.ros.agent.harness import World

ASK = "/guardian_activate_cloud_nodes"
SHIFTED_CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <time.h>

/* The system clock, and nothing else, is 200 ms ahead of the host's. */
int clock_gettime(clockid_t which, struct timespec *now) {
  static int (*real)(clockid_t, struct timespec *);
  if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
  int result = real(which, now);
  if (result == 0 && which == CLOCK_REALTIME) {
    now->tv_nsec += 200000000;
    if (now->tv_nsec >= 1000000000) { now->tv_nsec -= 1000000000; now->tv_sec += 1; }
  }
  return result;
}
"""


def shifted_clock(folder: Path) -> Path:
    """A library for LD_PRELOAD."""
    source, library = folder / "shifted.c", folder / "shifted.so"
    source.write_text(SHIFTED_CLOCK)
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"], check=True)
    return library


def test_a_cloud_whose_clock_differs_is_vetoed_and_the_difference_is_told(
    build: Callable[..., World], tmp_path: Path
) -> None:
    world = build(environment={"cloud": {"LD_PRELOAD": str(shifted_clock(tmp_path))}})
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side)
    world.until(lambda: world.reason == "ClockOffset", "the veto")
    assert "differ by at least" in world.message
    world.until(lambda: "ClockOffset" in world.ear.trigger(ASK).message, "a switch by hand is refused for it")
    world.passes("robot", 30)
    assert {a.site for a in world.arrivals} == {"robot"}
    world.until(lambda: 150 < float(world.ear.diagnostics["link"].values["clock_offset_ms"]) < 250, "the offset")


def test_an_observer_says_what_it_would_do_and_never_switches(build: Callable[..., World]) -> None:
    world = build(robot={"mode": "Observe"})
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side)
    world.until(lambda: "would act on the cloud" in world.message, "what it would do")
    answer = world.ear.trigger(ASK)
    assert not answer.success
    assert "Observe" in answer.message
    world.passes("robot", 30)
    assert {a.site for a in world.arrivals} == {"robot"}
    world.cut("both")
    world.until(lambda: "would act on the robot" in world.message, "what it would do after a cut")
    world.check()
