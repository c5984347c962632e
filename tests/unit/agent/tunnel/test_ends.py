"""Both ends of the tunnel over real sockets and real TLS."""

from __future__ import annotations

import asyncio
import ssl
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.tunnel import ends
from robot_offload_agent.tunnel.ends import Tunnel
from tests.unit.agent.tunnel.certified import PATIENCE_S, Rig, Router, answered, ask, certified, running


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return certified(tmp_path)


def test_bytes_cross_both_ways(rig: Rig) -> None:
    async def story() -> bytes:
        async with Router(rig.router), running(rig.cloud()), running(rig.robot()):
            return await answered(rig, b"hello" * 10_000)

    assert asyncio.run(story()) == b"HELLO" * 10_000


def test_who_has_no_certificate_of_the_robot_reaches_no_router(rig: Rig) -> None:
    async def story() -> tuple[bytes, int]:
        async with Router(rig.router) as router, running(rig.cloud()), running(rig.robot("foreign")):
            return await ask(rig), router.connections

    assert asyncio.run(story()) == (b"", 0)


def test_a_cloud_of_another_authority_is_not_spoken_to(rig: Rig) -> None:
    async def story() -> tuple[bytes, int]:
        async with Router(rig.router) as router, running(rig.cloud()), running(rig.robot("misled")):
            return await ask(rig), router.connections

    assert asyncio.run(story()) == (b"", 0)


def test_silent_strangers_and_probes_do_not_hold_up_the_robot(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ends, "HANDSHAKE_S", 600.0)  # nobody is rid of the strangers by their time limit

    async def story() -> bytes:
        async with Router(rig.router), running(rig.cloud()):
            strangers = [await asyncio.open_connection("127.0.0.1", rig.door) for _ in range(50)]
            for _ in range(20):
                _, probe = await asyncio.open_connection("127.0.0.1", rig.door)
                probe.close()
            async with running(rig.robot()):
                found = await answered(rig)
            for _, writer in strangers:
                writer.close()
            return found

    assert asyncio.run(story()) == b"HELLO"


def test_the_robot_may_come_before_its_cloud_and_the_cloud_before_its_router(rig: Rig) -> None:
    async def story() -> bytes:
        async with running(rig.robot()):
            asked = asyncio.create_task(answered(rig))
            await asyncio.sleep(0.3)
            async with running(rig.cloud()):
                await asyncio.sleep(0.3)
                async with Router(rig.router):
                    return await asked

    assert asyncio.run(story()) == b"HELLO"


def test_a_new_connection_takes_the_place_of_one_that_a_cut_left_behind(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ends, "FAR_SILENT_S", 600.0)  # the old one does not end by itself

    async def story() -> tuple[bytes, bytes]:
        async with Router(rig.router), running(rig.cloud()), running(rig.robot()):
            reader, old = await asyncio.open_connection("127.0.0.1", rig.near)
            old.write(b"first")
            assert await reader.readexactly(5) == b"FIRST"
            found = await answered(rig), await asyncio.wait_for(reader.read(), PATIENCE_S)
            old.close()
            return found

    assert asyncio.run(story()) == (b"HELLO", b"")


def test_a_far_end_that_says_nothing_is_left_although_somebody_acknowledges(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ends, "SILENT_S", 600.0)  # which is not the limit for the far end

    async def story() -> bytes:
        async with Router(rig.router), running(rig.cloud()), running(rig.robot()):
            reader, writer = await asyncio.open_connection("127.0.0.1", rig.near)
            found = await asyncio.wait_for(reader.read(), PATIENCE_S)
            writer.close()
            return found

    assert asyncio.run(story()) == b""


def test_a_robot_without_the_right_certificate_cannot_end_the_connection_of_the_robot(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ends, "FAR_SILENT_S", 600.0)  # nobody speaks for long on a busy machine

    async def story() -> bytes:
        async with Router(rig.router), running(rig.cloud()), running(rig.robot()):
            reader, writer = await asyncio.open_connection("127.0.0.1", rig.near)
            writer.write(b"first")
            await reader.readexactly(5)
            thief = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            thief.check_hostname = False
            thief.verify_mode = ssl.CERT_NONE
            refusal, other = await asyncio.open_connection("127.0.0.1", rig.door, ssl=thief)
            other.write(b"let me in")
            with suppress(OSError):
                assert await asyncio.wait_for(refusal.read(), PATIENCE_S) == b""
            other.transport.abort()
            writer.write(b"again")
            found = await reader.readexactly(5)
            writer.close()
            return found

    assert asyncio.run(story()) == b"AGAIN"


def test_another_robot_of_the_same_authority_is_refused(rig: Rig) -> None:
    async def story(name: str) -> bytes:
        cloud = replace(rig.cloud(), peer_name=name)
        async with Router(rig.router), running(cloud), running(rig.robot()):
            return await (answered(rig) if name == "r1" else ask(rig))

    assert asyncio.run(story("r1")) == b"HELLO"
    assert asyncio.run(story("r2")) == b""


def test_a_name_that_is_not_known_at_first_is_looked_up_again(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    async def story() -> bytes:
        loop, asked = asyncio.get_running_loop(), 0
        real = loop.getaddrinfo

        async def sometimes(host: str, port: int, **options: object) -> object:
            nonlocal asked
            asked += host == "edge.test"
            if asked < 3:
                raise OSError("no network")
            return await real("127.0.0.1", port)

        monkeypatch.setattr(loop, "getaddrinfo", sometimes)
        async with Router(rig.router), running(rig.cloud()), running(rig.robot(host="edge.test", verify_name=False)):
            return await answered(rig)

    assert asyncio.run(story()) == b"HELLO"


def test_a_cloud_under_another_name_is_refused_where_the_name_is_checked(rig: Rig) -> None:
    async def story() -> tuple[bytes, int]:
        async with Router(rig.router) as router, running(rig.cloud()), running(rig.robot(host="localhost")):
            return await ask(rig), router.connections

    assert asyncio.run(story()) == (b"", 0)


def test_missing_certificates_are_named(rig: Rig) -> None:
    (rig.folder / "robot" / "own.key").unlink()
    with pytest.raises(ConfigurationError, match=r"own\.key"):
        Tunnel(rig.robot())


def test_the_robot_dials_with_the_pair_that_was_renewed_and_with_its_bundles_where_that_is_refused(rig: Rig) -> None:
    """The bundle's certificate is a stranger's here, then the renewed one is: what counts is who is let in."""

    def keeps(certificates: str) -> str:
        place = rig.folder / f"kept-{certificates}"
        place.mkdir()
        for name in ("pem", "key"):
            (place / f"robot.{name}").symlink_to(rig.folder / certificates / f"own.{name}")
        return str(place)

    async def story(bundled: str, renewed: str) -> bytes:
        configuration = replace(rig.robot(bundled), own=renewed)
        async with Router(rig.router), running(rig.cloud()), running(configuration):
            return await answered(rig)

    assert asyncio.run(story("foreign", keeps("robot"))) == b"HELLO"
    assert asyncio.run(story("robot", keeps("foreign"))) == b"HELLO"
    assert asyncio.run(story("robot", str(rig.folder / "nothing-yet"))) == b"HELLO"
