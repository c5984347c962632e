"""One identity, several claimants: a second robot, a foreign voice on the link, beats of another version."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh

from robot_offload_agent.link.zenoh_config import ZenohSettings, key, session_config
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.fence.token import Site
from robot_offload_core.words import beats
from robot_offload_lab.wire.emulated import EmulatedWire, Forward, WireConfig
from tests.ros.agent.harness import PATIENCE_S, World
from tests.ros.agent.namespaces import OtherHost
from tests.ros.agent.passage import UNDISTURBED_S, longest_gap_s

THIRD_DOMAIN = 78


def test_a_second_robot_of_the_same_identity_is_refused_and_the_first_goes_on(world: World) -> None:
    epoch, at_s = world.placed[-1].epoch, now_s()
    other = {"domain_id": THIRD_DOMAIN, "state_dir": "", "inhibit_service": "", "realtime": False}
    with OtherHost() as host, way_in(world, host.HERE) as endpoints:
        second = world.start_agent(
            "robot", name="second", namespace=host.name, runtime_dir=str(world.folder / "second"),
            link__verify_name=False, **other, **endpoints,
        )  # fmt: skip
        world.until(lambda: "DuplicateIdentity" in world.processes.log("second-agent"), "the second one is told why")
        world.until(lambda: "is refused" in world.processes.log("cloud-agent"), "the cloud says so")
        world.passes("cloud", 40)
        assert world.placed[-1].epoch == epoch
        assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
        second.terminate()
        second.wait(PATIENCE_S)


def test_a_second_robot_on_the_same_host_is_refused_at_its_start_and_only_one_side_is_ever_heard(world: World) -> None:
    since = len(world.arrivals)
    second = world.start_agent("robot", name="second", runtime_dir=str(world.folder / "second"), inhibit_service="")
    assert second.wait(PATIENCE_S) == 3
    assert f"it is process {world.agents['robot'].pid}" in world.processes.log("second-agent")
    world.passes("cloud", 40)
    assert {arrival.site for arrival in world.arrivals[since:]} == {"cloud"}


@contextmanager
def way_in(world: World, host: str) -> Iterator[dict[str, list[str]]]:
    """Makes the cloud reachable at an address of the test's host; gives the endpoints as parameters."""
    forwards = tuple(Forward(name, "udp", f"{host}:0", f"127.0.0.1:{port}") for name, port in world.ports.items())
    wire = EmulatedWire(WireConfig(forwards, realtime=True))
    wire.start()
    try:
        yield {f"link__{name}_endpoints": [f"quic/{host}:{wire.port(name)}"] for name in world.ports}
    finally:
        wire.stop()


@contextmanager
def voice(
    world: World, session: str = "pulse", side: str = "robot", *, large: bool = False,
    hears: Callable[[bytes], None] | None = None,
) -> Iterator[Callable[..., None]]:  # fmt: skip
    """A session with the certificates of a side that can say anything on the channels of that side.

    The robot's is one more beside the genuine one, with `large` as its lane for large messages; the cloud's takes the
    place of a cloud's agent that does not run. `hears` gets what the other side's relay writes.
    """
    assert world.certificates is not None
    paths = getattr(world.certificates, side)
    host = "127.0.0.1" if side == "robot" else "0.0.0.0"
    settings = ZenohSettings(
        side=side, session=session, uid=world.folder.name, endpoints=(f"quic/{host}:{world.ports[session]}",),
        ca=str(paths.ca), certificate=str(paths.certificate), private_key=str(paths.private_key),
        peer_name="cloud" if side == "robot" else "walker-1", fallback=(f"tls/{host}:{world.ports[session]}",),
    )  # fmt: skip
    config = session_config(settings, fallback=large, open_timeout_ms=round(PATIENCE_S * 1e3))
    opened = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    try:
        if hears is not None:
            other = "cloud" if side == "robot" else "robot"
            opened.declare_subscriber(key(settings, other, "relay"), lambda sample: hears(bytes(sample.payload)))
        yield lambda channel, payload, header=bytes(4): opened.put(
            key(settings, side, channel), payload, attachment=header
        )
    finally:
        opened.close()  # type: ignore[no-untyped-call]


def counted(world: World, reason: str) -> int:
    status = world.cloud_ear().diagnostics.get("link")
    return int(status.values.get(f"garbage.{reason}", "0")) if status else 0


def a_beat(uid: str) -> beats.Beat:
    return beats.Beat(uid, Site.ROBOT, "ab" * 16, 1, 1, 0, 0, None, beats.Permission(10**6, True, "", 10**9))


def beats_of_nobody(uid: str) -> dict[str, bytes]:
    """Beats that must be counted and ignored, by the reason that they are counted under."""
    good = beats.encode(a_beat(uid)).encode()
    return {
        "BareBeat": b"",
        "BadVersion": b"999 " + good[2:],
        "BadForm": b"1 \xff\xfe garbage",
        "ForeignUid": beats.encode(a_beat("somebody-else")).encode(),
    }


def test_garbage_and_unknown_versions_on_the_link_are_counted_and_change_nothing(world: World) -> None:
    epoch, at_s = world.placed[-1].epoch, now_s()
    known = {reason: counted(world, reason) for reason in beats_of_nobody("x")}
    with voice(world) as say:

        def heard() -> bool:
            for payload in beats_of_nobody(world.folder.name).values():
                say("beat", payload)
            return all(counted(world, reason) > before for reason, before in known.items())

        world.until(heard, "all of them are counted")
    with voice(world, "data") as say:
        for payload in (b"", b"{}", b"\xff" * 100):
            say("probe", payload)
            say("in/odom", payload)
    world.passes("cloud", 20)
    assert world.placed[-1].epoch == epoch
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S


@pytest.mark.parametrize("topic", ["/connectivity_test_local", "/connectivity_test_remote"])
def test_garbage_on_the_beat_topics_of_the_ros_link_changes_nothing(ros_world: World, topic: str) -> None:
    epoch, at_s = ros_world.placed[-1].epoch, now_s()
    for payload in beats_of_nobody("x").values():
        ros_world.ear.say(topic, payload.decode("latin-1"))
    ros_world.passes("cloud", 20)
    assert ros_world.placed[-1].epoch == epoch
    assert longest_gap_s(ros_world.arrivals, at_s) < UNDISTURBED_S
