"""One tree of transforms on both sides through changeovers, with tf2's own message type; two drivers on one topic."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from robot_offload_agent.runtime.clock import now_s
from robot_offload_lab.run import interfaces
from tests.ros.agent.ears import KEPT, Ear, wait_until
from tests.ros.agent.harness import PATIENCE_S, PATIENT, World
from tests.ros.agent.transform_buffer import TransformBuffer

STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEHIND_S = 0.25
"""How far behind the newest message RViz would look up on a link of some round trips."""
GAP_S = 3.0
"""Of a frame at 20 Hz, also on a machine that is busy; an idle one has less than 100 ms more than its period."""
CHANGEOVERS = 10
CHILDREN = ("odom", "base_link", "arm")
STATICS = ("gripper", "laser", "camera")
SHARED: dict[str, dict[str, Any]] = {
    "tf": {
        "type": "tf2_msgs/msg/TFMessage", "frames": ["map odom", "base_link arm"], "depth": 100, "node": "localizer",
    },
    "tf_static": {
        "type": "tf2_msgs/msg/TFMessage", "frames": ["arm gripper"], "durability": "transient_local", "node": "driver",
        "hot": ["robot", "cloud"], "depth": 100,
    },
    "joint_states": {"type": "sensor_msgs/msg/JointState", "node": "driver", "hot": ["robot", "cloud"]},
    "diagnostics": {"type": "diagnostic_msgs/msg/DiagnosticArray", "node": "driver", "hot": ["robot", "cloud"]},
}  # fmt: skip
TREE: dict[str, Any] = {
    "nodes": ["walker", "localizer", "driver"],
    "node.driver.lifecycle": False,
    "outputs": ["command", *SHARED],
}
for _name, _given in SHARED.items():
    _more = {"topic": f"/{_name}", "robot_topic": f"/offload/robot/{_name}", "cloud_topic": f"/offload/cloud/{_name}"}
    TREE |= {f"output.{_name}.{key}": value for key, value in {**_given, **_more, "shared": True}.items()}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The package tf2_msgs, on the search paths of this process and of those that it starts."""
    folder = interfaces.make(tmp_path_factory.mktemp("interfaces"), interfaces.TF2_MSGS)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in interfaces.environment(folder).items():
            patch.setenv(name, value)
        patch.syspath_prepend(str(folder))
        interfaces.load(folder, interfaces.TF2_MSGS)
        yield folder


@dataclass
class Listener:
    """All that is said on the shared topics below a prefix in one domain."""

    ear: Ear
    prefix: str
    buffer: TransformBuffer = field(default_factory=TransformBuffer)
    joints: list[str] = field(default_factory=list)
    statuses: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    looked: int = 0

    def __post_init__(self) -> None:
        tf = importlib.import_module("tf2_msgs.msg").TFMessage
        node = self.ear.node
        node.create_subscription(tf, f"{self.prefix}/tf", self.take, KEPT)
        node.create_subscription(tf, f"{self.prefix}/tf_static", self.buffer.take_fixed, STATIC)
        node.create_subscription(JointState, f"{self.prefix}/joint_states", lambda m: self.joints.extend(m.name), KEPT)
        node.create_subscription(DiagnosticArray, f"{self.prefix}/diagnostics", self.diagnosed, KEPT)

    def take(self, message: Any) -> None:
        self.buffer.take(message, now_s())
        for one in message.transforms:
            if one.child_frame_id == "base_link":
                stamp_s = one.header.stamp.sec + one.header.stamp.nanosec / 1e9 - BEHIND_S
                self.looked += 1
                self.failures += [failure for failure in [self.buffer.reaches("gripper", "map", stamp_s)] if failure]

    def diagnosed(self, message: DiagnosticArray) -> None:
        self.statuses += [s.name.partition(": ")[2] for s in message.status if "#" in s.name]

    def figures(self) -> str:
        """Returns the longest silence of each frame, and how many lookups failed."""
        gaps = ", ".join(f"{child} {1e3 * self.buffer.gap_s(child):.0f} ms" for child in CHILDREN)
        failed = f"{len(self.failures)} of {self.looked} lookups {BEHIND_S * 1e3:.0f} ms behind failed"
        return f"longest gaps: {gaps}; {failed} {self.failures[:2]}"

    def clear(self) -> None:
        """Forgets what was heard before the part that counts."""
        for heard in (self.joints, self.statuses, self.failures, self.buffer.faults):
            heard.clear()
        self.buffer.arrived.clear()


class Drivers:
    """The robot's other drivers: odom -> base_link, two static frames, wheels on /joint_states and /diagnostics."""

    def __init__(self, ear: Ear) -> None:
        messages = importlib.import_module("tf2_msgs.msg")
        self.stamped = importlib.import_module("geometry_msgs.msg").TransformStamped
        self.message = messages.TFMessage
        self.node, self.number = ear.node, 0
        self.transforms = self.node.create_publisher(self.message, "/tf", 100)
        self.joints = self.node.create_publisher(JointState, "/joint_states", 100)
        self.diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 100)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for child in ("laser", "camera"):
            publisher = self.node.create_publisher(self.message, "/tf_static", latched)
            publisher.publish(self.transform("base_link", child))
        self.node.create_timer(0.05, self.drive)

    def transform(self, parent: str, child: str) -> Any:
        one = self.stamped()
        one.header.stamp, one.header.frame_id = self.node.get_clock().now().to_msg(), parent
        one.child_frame_id, one.transform.translation.x, one.transform.rotation.w = child, float(self.number), 1.0
        return self.message(transforms=[one])

    def drive(self) -> None:
        self.number += 1
        self.transforms.publish(self.transform("odom", "base_link"))
        self.joints.publish(JointState(name=[f"wheels#{self.number}"]))
        self.diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name=f"driver: wheels#{self.number}")]))


def runs(heard: list[str]) -> list[str]:
    """The group's drivers in the order in which they were heard, one for each run of messages."""
    producers = [text.partition("#")[0] for text in heard if "driver" in text]
    return [one for place, one in enumerate(producers) if place == 0 or producers[place - 1] != one]


def numbers(heard: list[str], producer: str) -> list[int]:
    """The sequence of a producer."""
    return [int(text.partition("#")[2]) for text in heard if text.partition("#")[0] == producer]


def tree(world: World) -> list[Listener]:
    """Listeners to the public topics of both sides, then to the private ones."""
    ears = {"robot": world.ear, "cloud": world.cloud_ear()}
    public = [Listener(ear, "") for ear in ears.values()]
    return public + [Listener(ear, f"/offload/{side}") for side, ear in ears.items()]


def in_whole(world: World, listeners: list[Listener]) -> None:
    """Waits until each has the whole tree, statics included, and the robot's other driver is heard."""

    def lacking(one: Listener) -> set[str]:
        return {*CHILDREN, *STATICS} - {*one.buffer.known, *one.buffer.fixed}

    if not wait_until(lambda: not any(lacking(one) for one in listeners), PATIENCE_S):
        raise AssertionError(
            f"{[(o.ear.node.get_name(), o.prefix, lacking(o)) for o in listeners]}\n{world.processes.logs()}"
        )
    for one in listeners:
        world.until(lambda o=one: len(numbers(o.joints, "wheels")) > 5, f"wheels below '{one.prefix}'")  # type: ignore[misc]


def change_over(world: World, public: list[Listener]) -> None:
    """Places the robot and the cloud in turn; each holds until both sides have heard it for a while."""
    for side in ("robot", "cloud") * (CHANGEOVERS // 2):
        world.place(side, stay=True)
        for one in public:
            heard = one.buffer.arrived.setdefault("odom", [])
            start = len(heard)
            world.until(lambda h=heard, s=start: len(h) > s + 8, f"odom of the {side}")  # type: ignore[misc]


def test_one_tree_of_transforms_on_both_sides_through_ten_changeovers(made: Path, build: Callable[..., World]) -> None:
    assert made.exists()
    world = build(both={**TREE, **PATIENT}, program=Path(__file__).with_name("transforming.py"))
    Drivers(world.ear)
    everyone = tree(world)
    public = everyone[:2]
    world.start()
    in_whole(world, everyone)
    for one in everyone:
        one.clear()
    placed = len(world.placed)
    world.until(lambda: all(runs(o.joints) and runs(o.statuses) for o in public), "the cloud's driver is heard first")
    change_over(world, public)

    def announced() -> int:
        """Changes of the side in charge so far: on a busy machine a stay may end by itself as well."""
        sites = [change.site for change in world.placed[placed - 1 :]]
        return sum(before != after for before, after in pairwise(sites))

    for one in public:
        where = one.ear.node.get_name()
        assert one.buffer.faults == [], f"{where}: every transform once"
        held = [*map(len, (one.buffer.stays("odom"), one.buffer.stays("arm"), runs(one.joints), runs(one.statuses)))]
        assert min(held) > CHANGEOVERS, f"each change is heard at the {where}"
        world.until(lambda h=held: max(h) <= announced() + 1, f"none of the standby's at the {where}: {held}")  # type: ignore[misc]
        sys.stdout.write(f"{where}: {one.figures()}\n")
        assert max(one.buffer.gap_s(child) for child in CHILDREN) < GAP_S
    for one in everyone:
        assert one.buffer.out_of_order() == [], one.prefix
        for said in (one.joints, one.statuses):
            wheels = numbers(said, "wheels")
            assert wheels == list(range(wheels[0], wheels[-1] + 1)), f"all of the other driver below '{one.prefix}'"
    in_whole(world, tree(world))  # whoever comes late
    world.check()
