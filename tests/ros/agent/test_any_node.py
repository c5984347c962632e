"""Nodes of every kind: one in the cloud only, whose results reach the robot; one without a lifecycle on both sides."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Header

from robot_offload_agent.runtime.clock import now_s
from robot_offload_lab.judge.recording import Arrival
from tests.ros.agent.ears import LATCHED, Ear
from tests.ros.agent.harness import MEASURING_S, PATIENT, World

RESULT_AGE_S = 0.2
GAP_S = 3.0
"""Of a topic at 20 Hz, also on a machine that is busy."""
DETECTIONS: dict[str, Any] = {
    "outputs": ["command", "detections"],
    "output.detections.topic": "/detections",
    "output.detections.rate_hz": 20.0,
    "output.detections.deadline_ms": 500.0,
    "output.detections.robot_topic": "/offload/robot/detections",
    "output.detections.cloud_topic": "/detector/command",
    "output.detections.node": "detector",
    "output.detections.of_cloud": True,
    "output.detections.max_age_ms": RESULT_AGE_S * 1e3,
}


class Statements:
    """What a program of the robot hears of the nodes with placement Cloud."""

    def __init__(self, ear: Ear) -> None:
        self.heard: list[tuple[float, DiagnosticArray]] = ear.hear(DiagnosticArray, "/offload/available", LATCHED)

    def reason(self, node: str) -> str:
        """The reason of the newest statement on a node; "" while it is available."""
        status = {status.name: status for status in self.heard[-1][1].status}[node] if self.heard else None
        return status.values[0].value if status is not None else "nothing stated"


def young(results: list[Arrival]) -> bool:
    """No result is older than its age at the consumer."""
    return all(a.t_s - a.sent_t_s < RESULT_AGE_S + MEASURING_S for a in results)


def test_results_of_a_cloud_node_reach_a_robot_whose_plain_node_runs_on_both_sides_and_a_cut_is_stated(
    build: Callable[..., World],
) -> None:
    world = build(
        both={**DETECTIONS, "node.walker.lifecycle": False},
        cloud={"nodes": ["walker", "detector"], "node.detector.duplicated": False},
        plain=True,
    )
    results, statements = world.ear.arrivals("/detections"), Statements(world.ear)

    def flow(count: int = 10) -> None:
        start = len(results)
        world.until(lambda: len(results) - start >= count, f"{count} results")

    world.start_node("cloud", other="detector")
    world.start()
    flow()
    world.until(lambda: statements.reason("detector") == "", "the detector is available")
    world.place("robot", stay=True)
    flow(40)
    assert world.site == "robot"

    cut_s = world.cut("both")
    world.until(lambda: statements.reason("detector") == "HeartbeatLost", "the cut is stated")
    world.until(lambda: now_s() - cut_s > 1.5, "the cut lasts")
    late = [a for a in results if a.t_s > cut_s + RESULT_AGE_S + MEASURING_S]
    assert late == []
    world.cut(None)
    world.until(lambda: statements.reason("detector") == "", "the detector is available again")
    flow(20)

    world.kill("cloud", "data")
    flow(20)
    consumers = world.cloud_ear().arrivals("/detections")
    world.until(lambda: len(consumers) > 5, "the detector's neighbours in the cloud hear it")
    sequences = [int(a.sequence) for a in results]
    assert sequences == sorted(set(sequences)), "each result once and in order"
    assert young(results)

    world.place("cloud")
    world.kill_node("cloud")
    world.until(lambda: world.site == "robot", "the silence of the replica ends the stay")
    world.passes("robot", 10)
    world.check()


POSES: dict[str, Any] = {
    "nodes": ["walker", "localizer"],
    "node.localizer.may_differ": ["rate_hz"],
    "outputs": ["command", "poses"],
    "output.poses.topic": "/poses",
    "output.poses.type": "std_msgs/msg/Header",
    "output.poses.shared": True,
    "output.poses.robot_topic": "/localizer/command",
    "output.poses.cloud_topic": "/remote_localizer/command",
    "output.poses.node": "localizer",
}


def numbers(heard: list[tuple[float, Header]], producer: str) -> list[int]:
    """The sequence of one producer's messages, in the order of arrival."""
    parts = [message.frame_id.partition("#") for _, message in list(heard)]
    return [int(number) for name, _, number in parts if name.partition(".")[0] == producer]


def once(found: list[int]) -> bool:
    """Each message once and in order."""
    return found == sorted(set(found))


def gap_s(heard: list[tuple[float, Header]]) -> float:
    """The longest silence of the group, in seconds."""
    times = [at_s for at_s, message in list(heard) if "localizer" in message.frame_id]
    return max(later - earlier for earlier, later in pairwise(times))


def test_a_shared_topic_is_heard_whole_and_once_on_both_sides_through_ten_changeovers(
    build: Callable[..., World],
) -> None:
    world = build(both={**POSES, **PATIENT})
    cloud_ear = world.cloud_ear()
    heard = {
        "robot": world.ear.hear(Header, "/poses"), "robot replica": world.ear.hear(Header, "/localizer/command"),
        "cloud": cloud_ear.hear(Header, "/poses"), "cloud replica": cloud_ear.hear(Header, "/remote_localizer/command"),
    }  # fmt: skip
    world.start_node("robot", other="localizer")
    world.start_node("cloud", other="remote_localizer")
    world.start()
    world.ear.feed("/poses", 20.0)
    world.until(lambda: all(len(numbers(h, "feed")) > 5 for h in heard.values()), "others are heard everywhere")
    for messages in heard.values():
        messages.clear()
    for _ in range(5):
        for side, other, producer in (("robot", "cloud", "localizer"), ("cloud", "robot", "remote_localizer")):
            world.place(side, stay=True)
            replica = heard[f"{other} replica"]
            start = len(numbers(replica, producer))
            world.until(lambda r=replica, p=producer, s=start: len(numbers(r, p)) > s + 3, f"{other} hears the {side}")
    for where, messages in heard.items():
        for producer in ("feed", "localizer", "remote_localizer"):
            assert once(numbers(messages, producer)), f"{producer} in {where}"
        assert len(numbers(messages, "feed")) > 50, where
    feed = numbers(heard["robot replica"], "feed")
    assert feed == list(range(feed[0], feed[-1] + 1)), "the robot's replica misses nothing of others"
    assert gap_s(heard["robot"]) < GAP_S
    world.check()
