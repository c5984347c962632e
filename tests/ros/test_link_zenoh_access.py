"""What a certificate is good for at the cloud's listener, tried with plain Zenoh clients that know all about us."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robot_offload_agent.link.zenoh_config import KEY_PREFIX, key, session_config
from robot_offload_lab.run.certificates import CertificatePaths, client_paths
from tests.ros.ports import HOST
from tests.ros.zenoh_ends import End, Ends, all_in, connected, crosses, eventually, make_settings, new_certificates

pytestmark = pytest.mark.ros

STRANGER = "another-robot"
SOUND_S = 0.7
"""Long enough for what is let through to arrive: everything else in these tests takes a few milliseconds."""
OPEN_MS = 60_000
"""For a client that is to be let in, also by a busy machine."""


class Thief:
    """A plain client with a certificate, and what it hears from others than itself."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.heard: list[tuple[str, bytes]] = []
        for keys in (f"{KEY_PREFIX}/**", "**"):
            self.listen(keys)

    def listen(self, keys: str) -> None:
        self.session.declare_subscriber(keys, self._hear, allowed_origin=zenoh.Locality.REMOTE)

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))


@contextmanager
def thief(paths: CertificatePaths, port: int, name: str, protocol: str = "quic") -> Iterator[Thief]:
    """A client with the certificate of `name` and none of our rules in its own configuration."""
    files = client_paths(Path(paths.robot.certificate).parent, name)
    settings = make_settings(
        paths, "robot", port, certificate=str(files.certificate), private_key=str(files.private_key),
        fallback=(f"tls/{HOST}:{port}",),
    )  # fmt: skip
    config = session_config(settings, fallback=protocol == "tls", open_timeout_ms=OPEN_MS)
    del config["access_control"]
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    try:
        yield Thief(session)
    finally:
        session.close()  # type: ignore[no-untyped-call]  # the wheel does not annotate it


@pytest.fixture
def pair(tmp_path: Path, port: int, ends: Ends) -> tuple[CertificatePaths, End, End]:
    paths = new_certificates(tmp_path, clients=[STRANGER, "observer"])
    tls = (f"tls/{HOST}:{port}",)
    cloud = ends.open(make_settings(paths, "cloud", port, fallback=tls, observers=("observer",)))
    robot = ends.open(make_settings(paths, "robot", port))
    connected(robot, cloud)
    crosses(robot, cloud)
    crosses(cloud, robot, "out/cmd")
    return paths, robot, cloud


def forge(who: Thief, robot: End, *channels: tuple[str, str]) -> None:
    for side, channel in channels:
        for erase in (False, True):
            where = key(robot.link.settings, side, channel)
            if erase:
                who.session.delete(where, attachment=b"\0\0\0\0HEADER")
            else:
                who.session.put(where, b"forged", attachment=b"\0\0\0\0HEADER")


def is_forged(message: tuple[str, bytes, bytes]) -> bool:
    return message[1] == b"HEADER"


@pytest.mark.parametrize("protocol", ["quic", "tls"])
@pytest.mark.parametrize("name", ["robot", STRANGER])
def test_no_certificate_of_a_robot_speaks_as_the_cloud_or_hears_a_robot(
    pair: tuple[CertificatePaths, End, End], port: int, name: str, protocol: str
) -> None:
    paths, robot, cloud = pair
    with thief(paths, port, name, protocol) as who:
        who.listen(key(robot.link.settings, "robot", "in/scan"))
        forge(who, robot, ("cloud", "out/cmd"), ("cloud", "beat"))
        crosses(robot, cloud)
        crosses(cloud, robot, "out/cmd")
        time.sleep(SOUND_S)
        assert not any(map(is_forged, robot.received)), "the robot hears the thief as if it were the cloud"
        assert not [heard for heard in who.heard if "/robot/" in heard[0]], "the thief hears the robot"
    assert robot.link.status().connected


def test_the_certificate_of_another_robot_says_and_hears_nothing_at_all(
    pair: tuple[CertificatePaths, End, End], port: int
) -> None:
    paths, robot, cloud = pair
    with thief(paths, port, STRANGER) as who:
        for side, channel in (("robot", "in/scan"), ("cloud", "out/cmd")):
            who.listen(key(robot.link.settings, side, channel))
        forge(who, robot, ("robot", "in/scan"), ("robot", "beat"), ("cloud", "out/cmd"))
        crosses(robot, cloud)
        crosses(cloud, robot, "out/cmd")
        time.sleep(SOUND_S)
        assert who.heard == []
        assert not any(map(is_forged, [*robot.received, *cloud.received]))


def test_queries_liveliness_and_the_administration_of_the_cloud_are_closed(
    pair: tuple[CertificatePaths, End, End], port: int
) -> None:
    paths, robot, _cloud = pair
    asked: list[Any] = []
    with thief(paths, port, "robot") as who:
        zid = str(next(iter(who.session.info.routers_zid())))
        who.session.declare_queryable(f"{KEY_PREFIX}/**", asked.append, complete=True)
        token = who.session.liveliness().declare_token(f"{KEY_PREFIX}/{robot.link.settings.uid}/robot/token")
        for keys in (f"@/{zid}/**", f"{KEY_PREFIX}/**"):
            answers = who.session.get(keys, timeout=SOUND_S, target=zenoh.QueryTarget.ALL)
            assert not [a for a in answers if a.ok is not None and zid in str(a.ok.key_expr)]
        assert not [a for a in who.session.liveliness().get("**", timeout=SOUND_S) if a.ok is None]
        token.undeclare()
        asked.clear()  # what it asked itself
    with thief(paths, port, "observer") as other:
        list(other.session.get(f"{KEY_PREFIX}/**", timeout=SOUND_S, target=zenoh.QueryTarget.ALL))
        assert list(other.session.liveliness().get(f"{KEY_PREFIX}/**", timeout=SOUND_S)) == []
    assert asked == []


def test_an_observer_hears_both_sides_and_says_nothing(pair: tuple[CertificatePaths, End, End], port: int) -> None:
    paths, robot, cloud = pair
    with thief(paths, port, "observer") as who:
        forge(who, robot, ("robot", "in/scan"), ("cloud", "out/cmd"))

        def both() -> bool:
            crosses(robot, cloud)
            crosses(cloud, robot, "out/cmd")
            return all_in(["/robot/data/in/scan", "/cloud/data/out/cmd"], {h[0].partition("-7")[2] for h in who.heard})

        eventually(both, "the observer hears both sides")
        assert not any(map(is_forged, [*robot.received, *cloud.received]))
        assert cloud.link.status().connected


def test_a_client_with_another_certificate_does_not_count_as_the_robot(
    paths: CertificatePaths, port: int, ends: Ends, tmp_path: Path
) -> None:
    made = new_certificates(tmp_path, clients=[STRANGER])
    cloud = ends.open(make_settings(made, "cloud", port))
    eventually(lambda: cloud.link.status().message == "no robot is connected")
    with thief(made, port, STRANGER):
        time.sleep(SOUND_S)
        assert not cloud.link.status().connected
        assert not cloud.link.send("out/cmd", b"", b"")
    connected(ends.open(make_settings(made, "robot", port)), cloud)
