"""What does not cross, and what is waited for: messages above `maxMessageSize`, state that a side does not know."""

from __future__ import annotations

from collections.abc import Callable

from std_msgs.msg import String

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.ears import LATCHED, Ear
from tests.ros.agent.harness import World
from tests.ros.agent.test_state import PROGRAM

PATIENCE_S = 60.0
SETTLE_S = 4.0
LATE_S = 2.0
"""Half of it: what a busy machine may take to say that a side was called off."""
MOST_BYTES = 4096
DECLARED = {
    "states": ["walker_1", "walker_2"],
    "state.walker_1.node": "walker",
    "state.walker_1.kind": "Snapshot",
    "state.walker_1.max_age_ms": 500.0,
    "state.walker_1.max_size": 1024,
    "state.walker_2.node": "walker",
    "state.walker_2.kind": "Topic",
    "state.walker_2.topic": "/lap",
    "state.walker_2.restore": "/lap_of_other",
    "node.walker.may_differ": ["rate_hz", "pace"],
    "max_message_size": MOST_BYTES,
    "prepare_deadline_ms": 2000.0,
    "settle_for_ms": SETTLE_S * 1e3,
}


def problems(ear: Ear) -> dict[str, str]:
    """What the agent on the ear's side says of its data process; empty before it has said anything."""
    status = ear.diagnostics.get("data")
    return status.values if status else {}


def listener(world: World) -> Ear:
    """Takes the cloud's node's place, which hears nothing of the laps that its replica said."""
    ear = Ear(world.domain["cloud"], "listener")
    ear.hear(String, "/offload/cloud/lap_of_other")
    return ear


def test_too_large_a_message_is_named_and_a_side_waits_for_state_or_is_called_off_and_settles(
    build: Callable[..., World],
) -> None:
    world = build(program=PROGRAM, both=DECLARED)
    world.ear.hear(String, "/offload/robot/lap_of_other")
    listens = listener(world)
    world.start()
    far = world.cloud_ear()
    maps = far.hear(String, "/map", LATCHED)
    world.until(lambda: maps, "the map crosses", PATIENCE_S)

    world.map.publish(String(data="." * (MOST_BYTES + 1)))
    world.until(lambda: "map: a message of" in problems(world.ear)["MessageTooLarge"], "it is named", PATIENCE_S)
    assert int(problems(world.ear)["map.too_large"]) == 1
    world.map.publish(String(data="a smaller map"))
    world.until(lambda: maps[-1][1].data == "a smaller map", "one that fits crosses", PATIENCE_S)
    assert all(len(said.data) <= MOST_BYTES for _, said in maps)
    world.until(lambda: "MessageTooLarge" not in problems(world.ear), "nothing is wrong any more", PATIENCE_S)

    world.place("robot", stay=True)
    assert world.ear.set_parameter("/walker", "pace", "silent").successful
    world.until(lambda: "StateStale" in problems(far), "the cloud's node knows nothing young", PATIENCE_S)
    begun = len(world.placed)
    world.override("Auto")

    def stale(words: str) -> bool:
        return any(said.reason == "StateStale" and words in said.message for said in world.placed[begun:])

    world.until(lambda: stale("no snapshot younger"), "the change waits for a snapshot", PATIENCE_S)
    assert {said.phase for said in world.placed[begun:]} == {"Robot"}, "the cloud's node sleeps meanwhile"
    listens.close()
    begun_s = now_s()
    assert world.ear.set_parameter("/walker", "pace", "slow").successful

    def seen(state: str, since_s: float) -> bool:
        node = far.diagnostics["node walker"]
        return node.message == state and node.t_s > since_s

    world.until(lambda: seen("active", begun_s), "the cloud gets ready", PATIENCE_S)
    world.until(lambda: stale("lap_of_other"), "it is called off for what it does not take", PATIENCE_S)
    world.override("Robot")
    called_off_s = now_s()
    world.until(lambda: seen("inactive", called_off_s), "its node goes to sleep", PATIENCE_S)
    assert far.diagnostics["node walker"].t_s - called_off_s > SETTLE_S - LATE_S
    listens = listener(world)
    world.override("Auto")
    world.goes_to("cloud")
    listens.close()
