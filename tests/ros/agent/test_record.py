"""`--record`: what the robot's agent writes about its link is what `robot-offload simulate --trace` reads."""

from collections.abc import Callable
from pathlib import Path

from robot_offload_lab.links.recorded import Trace, TraceError, load_trace
from tests.ros.agent.harness import World

DELAY_MS = 5.0


def recorded(file: Path) -> Trace | None:
    """The recording so far; None while there is none that can be read."""
    try:
        return load_trace(file)
    except (OSError, TraceError):
        return None


def test_the_robots_agent_records_round_trips_and_what_was_lost(build: Callable[..., World]) -> None:
    world = build()
    file = world.folder / "link.csv"
    assert world.wire is not None
    world.wire.set(delay_ms=DELAY_MS)
    world.start_agent("cloud")
    world.start_node("cloud")
    world.start_agent("robot", options=["--record", str(file)])
    world.start_node("robot")
    world.goes_to("cloud")
    world.until(lambda: (trace := recorded(file)) is not None and len(trace.rtts_ms) > 50, "a second of the link")
    world.cut("both")
    world.goes_to("robot")
    world.cut(None)
    world.goes_to("cloud")
    world.until(lambda: (trace := recorded(file)) is not None and None in trace.rtts_ms, "what was lost is written")
    trace = recorded(file)
    assert trace is not None
    came = [rtt_ms for rtt_ms in trace.rtts_ms if rtt_ms is not None]
    assert min(came) >= 2 * DELAY_MS - 0.5, "no beat is faster than the link"
    world.check()
