"""The emulated link as a process: its schedule, log and control socket, how it starts and how it ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from robot_offload_lab.wire.emulated import EmulatedWire, Forward, WireConfig, WireProcessError
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.model import WireError
from tests.unit.lab.wire.wires import (
    HOST,
    PATIENCE_S,
    accept,
    arrives_within,
    ended,
    eventually,
    free_port,
    tcp_listener,
    udp_client,
    udp_echo,
    wire,
)


def lines(log: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in log.read_text().splitlines()]


def test_the_schedule_starts_on_command_and_its_outages_are_logged(tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    with udp_echo() as port, wire("udp", port, log=log, outages=("0.6/1.2",)) as emulated:
        with udp_client(emulated) as client:
            time.sleep(0.8)
            client.send(b"not started")
            assert client.recv(100) == b"not started"
            before_s = steady_s()
            started_s = emulated.start_schedule()
            assert before_s <= started_s <= steady_s()
            # Asked again and again: a busy machine may sleep through an outage, and the next one comes.
            assert eventually(lambda: client.send(b"lost") and emulated.status()["up"]["dropped"])
            assert eventually(lambda: client.send(b"back") and arrives_within(client, 0.05) == b"back")
        assert eventually(lambda: sum(line["event"] == "changed" for line in lines(log)) >= 2)
    events = lines(log)
    assert events[0]["event"] == "listening"
    assert events[-1]["event"] == "stopped"
    changed = [line for line in events if line["event"] == "changed"]
    assert [line["conditions"]["down"]["cut"] for line in changed[:2]] == [True, False]
    assert changed[0]["t_s"] - started_s > 0.599
    counters = [line for line in events if line["event"] == "counters"]
    assert len(counters) >= 3
    assert counters[-1]["up"]["datagrams"] >= 3
    assert counters[-1]["up"]["dropped"] >= 1
    assert {line["up"]["dropped"] for line in counters if line["t_s"] < started_s + 0.599} == {0}
    assert [line["t_s"] for line in events] == sorted(line["t_s"] for line in events)


def test_both_protocols_on_one_number_share_one_link(tmp_path: Path) -> None:
    with udp_echo() as port, tcp_listener() as listener:
        number = free_port()
        config = WireConfig(
            forwards=(
                Forward("quic", "udp", f"{HOST}:{number}", f"{HOST}:{port}"),
                Forward("tls", "tcp", f"{HOST}:{number}", f"{HOST}:{listener.getsockname()[1]}"),
            ),
            control=str(tmp_path / "control.sock"),
        )
        with (
            EmulatedWire(config) as emulated,
            socket.create_connection((HOST, number), timeout=PATIENCE_S),
            accept(listener),
        ):
            assert emulated.port("quic") == emulated.port("tls") == number
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
                client.connect((HOST, number))
                client.send(b"x")
                assert arrives_within(client, PATIENCE_S) == b"x"
            assert emulated.status()["clients"] == {"quic": 1, "tls": 1}


def test_a_control_message_needs_no_answer_and_nonsense_is_logged(tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    config = WireConfig(
        (Forward("port", "udp", f"{HOST}:0", f"{HOST}:9"),), control=str(tmp_path / "c.sock"), log=str(log)
    )
    with EmulatedWire(config) as emulated, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as anonymous:
        for message in (b"\xff", b"[]", b'{"set": 3}', b'{"start": true, "set": {}}', b'{"set": {"cut": "left"}}'):
            anonymous.sendto(message, config.control)
        anonymous.sendto(b'{"set": {"cut": "both"}}', config.control)
        assert eventually(lambda: emulated.status()["conditions"]["up"]["cut"])
    events = [line["event"] for line in lines(log)]
    assert events.count("refused") == 5
    assert events.count("set") == 1


def test_a_taken_port_is_told_and_nothing_is_left(tmp_path: Path) -> None:
    with udp_echo() as port:
        config = WireConfig((Forward("pulse", "udp", f"{HOST}:{port}", f"{HOST}:9"),), control=str(tmp_path / "c"))
        with pytest.raises(WireProcessError, match=rf"udp port {HOST}:{port} \(pulse\): .*in use"):
            EmulatedWire(config).start()
    assert not (tmp_path / "c").exists()


def test_a_wrong_option_is_told_before_anything_starts() -> None:
    emulated = wire("udp", 9, delay="soon")
    with pytest.raises(WireError, match="--delay: 'soon' is not a valid time"):
        emulated.start()
    assert emulated.pid is None


def test_a_stopped_link_says_so() -> None:
    emulated = wire("udp", 9)
    with pytest.raises(WireProcessError, match="not running"):
        emulated.cut("up")
    with emulated:
        pid = emulated.pid
    emulated.stop()
    assert pid is not None
    assert not Path(f"/proc/{pid}").exists()
    assert emulated.pid is None


def test_a_killed_link_is_noticed() -> None:
    with wire("udp", 9) as emulated:
        assert emulated.pid is not None
        os.kill(emulated.pid, signal.SIGKILL)
        assert eventually(lambda: ended(emulated.pid or 0))
        with pytest.raises(WireProcessError, match="does not answer"):
            emulated.status()


def test_the_process_ends_with_its_parent(tmp_path: Path) -> None:
    script = (
        "import time; from robot_offload_lab.wire.emulated import *\n"
        "wire = EmulatedWire(WireConfig((Forward('p', 'udp', '127.0.0.1:0', '127.0.0.1:9'),)))\n"
        "wire.start(); print(wire.pid, flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=tmp_path) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.kill()
    assert eventually(lambda: ended(pid))


def test_a_broken_configuration_file_ends_with_code_2(tmp_path: Path) -> None:
    (tmp_path / "wire.json").write_text("{}")
    for path, message in ((tmp_path / "wire.json", "'forwards' is missing"), (tmp_path / "none.json", "No such file")):
        done = subprocess.run(
            [sys.executable, "-m", "robot_offload_lab.wire.emulated", "--config", str(path)],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 2
        assert message in done.stderr
        assert "Traceback" not in done.stderr


def test_real_time_priority_is_taken_or_its_refusal_logged(tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    forward = Forward("port", "udp", f"{HOST}:0", f"{HOST}:9")
    with EmulatedWire(WireConfig((forward,), log=str(log), realtime=True)) as emulated:
        assert emulated.pid is not None
        realtime = os.sched_getscheduler(emulated.pid) == os.SCHED_FIFO
    assert realtime != any(line["event"] == "realtime_refused" for line in lines(log))
