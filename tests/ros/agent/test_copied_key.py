"""A copy of the robot's certificate, in the hands of a stranger who hears all that a robot may hear."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from robot_offload_agent.link.zenoh_config import KEY_PREFIX, ZenohSettings, session_config
from robot_offload_agent.runtime.clock import now_us
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words import beats
from robot_offload_core.words.beats import Beat, CloudReport, Echo, Permission
from tests.ros.agent.harness import World

FORGED = "forged"
LATER = 1 << 40
NUMBERED = bytes(4)
"""What the link puts before each attachment."""


class Thief:
    """Two sessions with the robot's files and without our access rules."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.prefix = f"{KEY_PREFIX}/{world.folder.name}"
        self.lock = threading.Lock()
        self.heard: list[tuple[str, bytes]] = []
        self.beats: list[Beat] = []
        self.sessions = {name: self._open(name) for name in ("pulse", "data")}

    def _open(self, name: str) -> zenoh.Session:
        assert self.world.certificates is not None
        paths = self.world.certificates.robot
        settings = ZenohSettings(
            side="robot", session=name, uid=self.world.folder.name,
            endpoints=(f"quic/127.0.0.1:{self.world.ports[name]}",),
            ca=str(paths.ca), certificate=str(paths.certificate), private_key=str(paths.private_key), peer_name="cloud",
        )  # fmt: skip
        plain = session_config(settings, open_timeout_ms=20_000)
        del plain["access_control"]
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(plain)))
        for side in ("cloud", "robot"):  # one for all keys would be refused whole
            session.declare_subscriber(f"{self.prefix}/{side}/{name}/**", self._hear)
        return session

    def _hear(self, sample: zenoh.Sample) -> None:
        attached = b"" if sample.attachment is None else sample.attachment.to_bytes()
        key, payload = str(sample.key_expr).removeprefix(f"{self.prefix}/"), sample.payload.to_bytes()
        with self.lock:
            self.heard.append((key, attached + payload))
            if key == "cloud/pulse/beat":
                self.beats.append(beats.decode(payload.decode()))

    def says_input(self, beat: Beat, number: int) -> None:
        """Says an input in the name under which the cloud knows the robot, newer than all others."""
        assert isinstance(beat.body, CloudReport)
        header = Envelope(Token(beat.body.serves, beat.body.epoch, beat.incarnation), (1 << 62) + number, beat.sent_us)
        self.sessions["data"].put(
            f"{self.prefix}/robot/data/in/odom", serialize_message(Header(frame_id=f"{FORGED}#{number}")),
            attachment=NUMBERED + envelope.encode(header),
        )  # fmt: skip

    def says_grant(self, beat: Beat, number: int) -> None:
        """Grants the cloud a lease of a newer epoch, in answer to its newest beat."""
        assert isinstance(beat.body, CloudReport)
        echo = Echo(beat.incarnation, beat.sequence, beat.sent_us, 0)
        grant = Permission(beat.body.epoch + 1000, True, beat.incarnation, 400_000, in_charge=True, presence=True)
        said = Beat(
            self.world.folder.name,
            Site.ROBOT,
            beat.body.serves,
            LATER + number,
            now_us() + 10_000_000,
            0,
            0,
            echo,
            grant,
        )
        self.sessions["pulse"].put(f"{self.prefix}/robot/pulse/beat", beats.encode(said).encode(), attachment=NUMBERED)


@contextmanager
def thief(world: World) -> Iterator[Thief]:
    """Lets a stranger in with a copy of the robot's key."""
    here = Thief(world)
    try:
        yield here
    finally:
        for session in here.sessions.values():
            session.close()


@pytest.mark.parametrize("speaks", [Thief.says_input, Thief.says_grant], ids=["inputs", "grants"])
def test_who_copied_the_robots_key_can_neither_steer_it_nor_make_the_cloud_act(
    build: Callable[..., World], speaks: Callable[[Thief, Beat, int], None]
) -> None:
    world = build()
    world.start()
    odom = world.cloud_ear().hear(Header, "/odom")
    world.until(lambda: odom, "the replicas hear the robot's own sensors")
    with thief(world) as here:
        world.until(lambda: len(here.beats) > 20, "the thief hears the cloud")
        for number in range(40):
            speaks(here, here.beats[-1], number)
            time.sleep(0.02)
        genuine = len(odom)
        world.until(lambda: len(odom) > genuine + 5, "the replicas go on with the robot's own sensors")
        epochs = {beat.body.epoch for beat in here.beats if isinstance(beat.body, CloudReport)}
        (name,) = {change.control for change in world.placed}
        # The robot's own words hold its name: of robot/** a session hears only what it says itself.
        assert not [key for key, said in here.heard if name.encode() in said or bytes.fromhex(name) in said]
    assert not [message for _, message in odom if message.frame_id.startswith(FORGED)]
    assert max(epochs) < 1000
    world.check()
