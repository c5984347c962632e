"""The emulated link's relays, with real sockets on loopback. No upper bounds on times: the machine may be busy."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from typing import Any

import pytest

from robot_offload_lab.wire.emulated import EmulatedWire, Forward
from robot_offload_lab.wire.link import ControlError, EmulatedLink
from robot_offload_lab.wire.loop import Loop, steady_s
from robot_offload_lab.wire.schedule import Schedule
from robot_offload_lab.wire.udp import UdpForward
from tests.unit.lab.wire.wires import (
    HOST,
    PATIENCE_S,
    accept,
    arrives_within,
    eventually,
    free_port,
    received,
    stream,
    tcp_client,
    tcp_listener,
    udp_client,
    udp_echo,
    wire,
)


def after(emulated: EmulatedWire, datagrams: int) -> dict[str, Any]:
    """The link's counters when it has taken so many datagrams of its client."""
    assert eventually(lambda: emulated.status()["up"]["datagrams"] == datagrams)
    return emulated.status()


# Datagrams


def test_a_datagram_and_its_answer_are_delayed_each_way() -> None:
    with udp_echo() as port, wire("udp", port, delay="40ms") as emulated, udp_client(emulated) as client:
        begin_s = time.monotonic()
        client.send(b"hello")
        assert client.recv(100) == b"hello"
        assert time.monotonic() - begin_s > 0.079


def test_the_largest_datagram_passes_unchanged() -> None:
    data = os.urandom(65507)
    with udp_echo() as port, wire("udp", port) as emulated, udp_client(emulated) as client:
        client.send(data)
        assert client.recv(65535) == data


def test_two_clients_get_their_own_answers() -> None:
    with udp_echo() as port, wire("udp", port, delay="5ms") as emulated:
        with udp_client(emulated) as first, udp_client(emulated) as second:
            for index in range(20):
                first.send(b"first %d" % index)
                second.send(b"second %d" % index)
            assert [first.recv(100) for _ in range(20)] == [b"first %d" % index for index in range(20)]
            assert [second.recv(100) for _ in range(20)] == [b"second %d" % index for index in range(20)]
        assert emulated.status()["clients"] == {"port": 2}


def test_the_share_of_lost_datagrams_is_as_told() -> None:
    count = 1000
    with udp_echo() as port, wire("udp", port, loss="20%/0%") as emulated, udp_client(emulated) as client:
        answers = 0
        for sent in range(20, count + 1, 20):
            for _ in range(20):
                client.send(b"x")
            dropped = after(emulated, sent)["up"]["dropped"]
            while answers < sent - dropped:
                assert client.recv(100) == b"x"
                answers += 1
        assert 0.13 < dropped / count < 0.27
        assert arrives_within(client, 0.1) is None, "what was dropped has no answer"


def test_a_cut_of_one_direction_drops_only_there() -> None:
    with udp_echo() as port, wire("udp", port) as emulated, udp_client(emulated) as client:
        emulated.cut("down")
        client.send(b"x")
        assert eventually(lambda: emulated.status()["down"]["dropped"] == 1)
        assert emulated.status()["up"]["dropped"] == 0
        emulated.cut("up")
        client.send(b"x")
        assert after(emulated, 2)["up"]["dropped"] == 1
        emulated.cut(None)
        client.send(b"back")
        assert client.recv(100) == b"back", "nothing came before it"


def test_an_absent_cloud_does_not_end_the_link() -> None:
    port = free_port()
    with wire("udp", port) as emulated, udp_client(emulated) as client:
        for _ in range(5):
            client.send(b"anybody there?")
            time.sleep(0.02)
        assert eventually(lambda: emulated.status()["up"]["errors"] + emulated.status()["down"]["errors"] > 0)
        with udp_echo(port):
            client.send(b"now?")
            assert client.recv(100) == b"now?", "the first datagram to a cloud that is back arrives"


def test_conditions_change_at_once() -> None:
    with udp_echo() as port, wire("udp", port) as emulated, udp_client(emulated) as client:
        emulated.set(delay_ms=150, up={"delay_ms": 50})
        begin_s = time.monotonic()
        client.send(b"x")
        assert client.recv(10) == b"x"
        assert time.monotonic() - begin_s > 0.199
        with pytest.raises(ControlError, match="loss must be a share"):
            emulated.set(loss=3)


def test_a_silent_client_is_forgotten_and_welcomed_again() -> None:
    loop, link = Loop(), EmulatedLink(Schedule(), seed=1)
    with udp_echo() as port, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        relay = UdpForward(loop, link, Forward("port", "udp", f"{HOST}:0", f"{HOST}:{port}"))
        client.connect((HOST, relay.port))
        client.settimeout(0)
        for _ in range(2):
            begin_s = steady_s()
            client.send(b"x")
            while link.counters["down"].datagrams < link.counters["up"].datagrams or not relay.clients:
                loop.call_at(steady_s() + 0.1, lambda: None)
                loop.run_once()
            assert client.recv(10) == b"x"
            relay.forget_idle(begin_s + 29)
            assert relay.clients == 1
            relay.forget_idle(steady_s() + 31)
            assert relay.clients == 0
        relay.close()
    loop.close()


# Streams


def test_a_stream_arrives_whole_in_both_directions() -> None:
    data = os.urandom(3_000_000)
    with stream(delay="5ms", jitter="3ms") as (_, client, server):
        for sender, receiver in ((client, server), (server, client)):
            thread = threading.Thread(target=sender.sendall, args=(data,))
            thread.start()
            assert received(receiver, len(data)) == data
            thread.join()
        client.shutdown(socket.SHUT_WR)
        assert server.recv(10) == b"", "the end of one direction passes"
        server.sendall(b"bye")
        assert client.recv(10) == b"bye", "while the other goes on"


def test_a_stream_is_delayed_each_way() -> None:
    with stream(delay="40ms") as (_, client, server):
        begin_s = time.monotonic()
        client.sendall(b"ping")
        server.sendall(server.recv(10))
        assert client.recv(10) == b"ping"
        assert time.monotonic() - begin_s > 0.079


def test_losses_delay_a_stream_and_lose_nothing() -> None:
    with stream(loss="20%/0%") as (emulated, client, server):
        for begin in range(0, 100, 4):  # at least 25 segments, however slowly the link reads
            for index in range(begin, begin + 4):
                client.sendall(b"%03d" % index)
                time.sleep(0.002)
            assert received(server, 12) == b"".join(b"%03d" % index for index in range(begin, begin + 4))
        assert emulated.status()["up"]["retransmissions"] > 0


def test_a_cut_leaves_a_stream_hanging_and_delivers_after_it() -> None:
    with stream() as (emulated, client, server):
        client.sendall(b"before")
        assert received(server, 6) == b"before"
        emulated.cut("both")
        client.sendall(b"during")
        assert arrives_within(server, 0.5) is None
        emulated.cut(None)
        client.sendall(b"-after")
        server.settimeout(PATIENCE_S)
        assert received(server, 12) == b"during-after"


def test_a_connection_opened_or_ended_in_a_cut_is_heard_of_after_it() -> None:
    with tcp_listener() as listener, wire("tcp", listener.getsockname()[1]) as emulated:
        client = tcp_client(emulated)
        server = accept(listener)
        emulated.cut("up")
        client.close()
        assert arrives_within(server, 0.3) is None, "neither data nor an end"
        late = tcp_client(emulated)
        listener.settimeout(0.3)
        with pytest.raises(TimeoutError):
            listener.accept()
        emulated.cut(None)
        listener.settimeout(PATIENCE_S)
        with late, accept(listener):
            assert arrives_within(server, PATIENCE_S) == b"", "the end of the first connection"
        server.close()


def test_a_killed_end_resets_the_other() -> None:
    with tcp_listener() as listener, wire("tcp", listener.getsockname()[1]) as emulated:
        with tcp_client(emulated) as client:
            server = accept(listener)
            server.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            server.close()
            with pytest.raises(ConnectionResetError):
                client.recv(10)
        assert eventually(lambda: emulated.status()["clients"] == {"port": 0})


def test_an_absent_cloud_resets_a_connection() -> None:
    with wire("tcp", free_port(), delay="20ms") as emulated:
        with tcp_client(emulated) as client, pytest.raises(ConnectionResetError):
            client.recv(10)
        assert eventually(lambda: emulated.status()["clients"] == {"port": 0})


def test_a_reader_that_sleeps_makes_its_writer_wait() -> None:
    with stream() as (_, client, server):
        client.settimeout(0.5)
        sent = 0
        with contextlib.suppress(TimeoutError):
            while sent < 200_000_000:
                sent += client.send(b"x" * 65536)
        assert sent < 200_000_000, "the link does not hold everything"
        assert len(received(server, sent)) == sent
