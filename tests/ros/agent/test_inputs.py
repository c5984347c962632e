"""Inputs on their way to the cloud: latched, limited in rate, limited in age, of types that only the graph knows."""

import time
from collections.abc import Callable

from std_msgs.msg import Header, String

from tests.ros.agent.ears import LATCHED, stamp_s
from tests.ros.agent.harness import World, header_numbers

EXTRA = {
    "inputs": ["odom", "map", "fast"],
    "input.fast.topic": "/fast",
    "input.fast.max_rate_hz": 10.0,
}


def texts(heard: list[tuple[float, String]]) -> list[str]:
    return [message.data for _, message in heard]


def too_old(world: World) -> int:
    """How many of /odom the cloud has refused for their age."""
    return int(world.cloud_ear().diagnostics["data"].values.get("odom.too_old", "0"))


def test_a_latched_input_reaches_a_cloud_that_starts_late_and_one_that_is_restarted(
    build: Callable[..., World],
) -> None:
    world = build()
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot")
    world.start_agent("cloud")
    heard = world.cloud_ear().hear(String, "/map", LATCHED)
    world.until(lambda: "a map" in texts(heard), "the map in a cloud that started late")
    world.kill_agent("cloud")
    world.map.publish(String(data="a newer map"))
    world.start_agent("cloud")
    late = world.cloud_ear().hear(String, "/map", LATCHED)
    world.until(lambda: "a newer map" in texts(late), "the map in a cloud that was restarted")
    world.start_node("cloud")
    world.goes_to("cloud")


def test_a_latched_input_that_changes_while_the_link_is_cut_arrives_when_it_heals(world: World) -> None:
    heard = world.cloud_ear().hear(String, "/map", LATCHED)
    world.until(lambda: heard, "the map")
    world.cut("both")
    world.map.publish(String(data="changed meanwhile"))
    world.goes_to("robot")
    world.cut(None)
    world.until(lambda: texts(heard)[-1] == "changed meanwhile", "the newer map")
    world.goes_to("cloud")


def test_an_input_is_forwarded_with_the_type_found_in_the_graph_and_no_faster_than_allowed(
    build: Callable[..., World],
) -> None:
    world = build(both=EXTRA)
    world.start_agent("robot")
    world.start_agent("cloud")
    heard = world.cloud_ear().hear(Header, "/fast")
    world.ear.feed("/fast", 50.0)
    world.until(lambda: len(heard) > 20, "the input in the cloud")
    stamps_s = [stamp_s(message) for _, message in heard]
    assert (len(stamps_s) - 1) / (stamps_s[-1] - stamps_s[0]) < 14.0
    numbers = header_numbers(heard)
    assert numbers == sorted(numbers)
    world.until(lambda: int(world.ear.diagnostics["data"].values.get("fast.rate_limited", "0")) > 0, "it is counted")


def test_an_input_that_is_too_old_does_not_reach_the_clouds_nodes(world: World) -> None:
    assert world.wire is not None
    heard = world.cloud_ear().hear(Header, "/odom")
    world.until(lambda: heard and too_old(world) >= 0, "odom arrives in the cloud, its data process reports")
    for delay_ms in range(50, 251, 50):  # step by step: no silence, so the session stays
        world.wire.set(delay_ms=delay_ms)
        time.sleep(0.3)
    world.goes_to("robot")
    refused = too_old(world)
    world.until(lambda: too_old(world) > refused, "it is too old")
    heard.clear()
    refused = too_old(world)
    world.until(lambda: too_old(world) > refused + 5, "it stays too old")
    assert not heard
    world.wire.set(delay_ms=0)
    world.until(lambda: heard, "odom arrives again")


def test_the_robot_acts_when_an_input_of_the_cloud_falls_silent(world: World) -> None:
    since = len(world.placed)
    world.odom.cancel()
    world.goes_to("robot")
    world.until(lambda: any(p.reason == "InputStale" for p in world.placed[since:]), "the reason")
    world.odom.reset()
    world.goes_to("cloud")


def test_what_passes_at_the_robot_reaches_consumers_in_the_cloud_exactly_once(world: World) -> None:
    heard = world.cloud_ear().arrivals("/command")
    for side in ("robot", "cloud"):
        world.place(side)
        world.until(lambda: len({a.sequence for a in heard if a.site == world.site}) > 10, f"the {side}'s messages")
    identities = [(a.producer, a.sequence) for a in heard]
    assert len(set(identities)) == len(identities)
