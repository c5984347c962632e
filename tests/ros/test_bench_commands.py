"""One tiny real run of each command of the bench: everything that it starts is real, only the amounts are small."""

from __future__ import annotations

import csv
import json
import os
import secrets
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robot_offload_lab.wire.two_hosts import TwoHosts
from tests.ros.test_bench_smoke import MARK, marked

SECONDS = 280
ROOT = pytest.mark.skipif(bool(TwoHosts.refusal()), reason=TwoHosts.refusal() or "-")


def bench(folder: Path, *arguments: str) -> dict[str, dict[str, Any]]:
    """Runs a command; returns its figures by name and checks that it leaves nothing behind."""
    run = secrets.token_hex(8)
    command = [sys.executable, "-m", "robot_offload", "bench", *arguments, "--out", str(folder), "--json"]
    environment = {**os.environ, MARK: run}
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False)
        assert ended.returncode == 0, ended.stderr
    finally:
        left = marked(run)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
    assert not left
    [group] = json.loads(ended.stdout)["groups"].values()
    return {figure["name"]: figure for figure in group["realtime"]["figures"]}


def samples(folder: Path, group: str) -> list[dict[str, str]]:
    with (folder / f"{group}-realtime.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.ros
def test_lifecycle_nodes_are_activated_in_every_case_and_none_refuses(tmp_path: Path):
    figures = bench(tmp_path, "lifecycle", "--rounds", "3")
    assert figures["refused"]["value"] == 0
    for case in ("alone", "heavy", "among", "together"):
        assert figures[f"{case}_activate_p50"]["count"] == 3
        assert figures[f"{case}_deactivate_p50"]["value"] > 0
    assert figures["heavy_activate_p50"]["value"] >= 50.0  # the work in its callback
    assert {"case", "series", "round", "ms"} == set(samples(tmp_path, "lifecycle")[0])
    assert (tmp_path / "bench-lifecycle-spread.png").exists()


@pytest.mark.ros
def test_the_collector_passes_every_message_of_a_light_load(tmp_path: Path):
    figures = bench(tmp_path, "collector", "--seconds", "0.5")
    assert figures["64_50_default_delivered"]["value"] == 100.0
    assert figures["64_50_default_p50"]["ratio"] > 1.0
    assert figures["1048576_10_large_data_p50"]["value"] > 0


@pytest.mark.ros
@ROOT
def test_ten_topics_travel_in_every_scenario_over_a_link_that_costs_its_delay(tmp_path: Path):
    figures = bench(
        tmp_path, "latency", "--messages", "10", "--case", "one-host", "--case", "two-hosts", "--case", "zenoh"
    )
    assert figures["one_host_p50"]["value"] < figures["zenoh_p50"]["value"]
    assert figures["two_hosts_p50"]["value"] >= 10.0  # the link's own delay, each way
    assert figures["zenoh_p50"]["value"] >= 10.0
    assert figures["zenoh_added_p50"]["must"] == 4.0
    assert {"one_host", "one_host_echo", "two_hosts", "zenoh"} == {
        row["scenario"] for row in samples(tmp_path, "experiment")
    }


@pytest.mark.ros
@ROOT
def test_a_cut_is_noticed_by_ours_and_by_every_rival(tmp_path: Path):
    figures = bench(tmp_path, "detect", "--cuts", "1", "--quiet", "1", "--case", "warm")
    noticed = [figures[f"warm_{number}_noticed_p50"]["value"] for number in range(4)]
    assert all(value is not None and value > 0 for value in noticed)
    assert noticed[2] > 2000.0  # the bond's patience is 4 s
    assert figures["warm_0_noticed_p50"]["ratio"] > 0
    assert {row["variant"] for row in samples(tmp_path, "detect")} == {"warm"}


@pytest.mark.ros
@ROOT
def test_two_hosts_hear_each_other_through_the_link_alone_and_leave_nothing():
    from robot_offload_lab.bench.parts.hop import datagram_socket, measure
    from robot_offload_lab.wire.options import LinkOptions
    from robot_offload_lab.wire.two_hosts import CLOUD_ADDRESS

    with TwoHosts(LinkOptions(delay="20ms"), 1) as hosts:
        process = Path(f"/proc/{hosts.pid}")
        with datagram_socket(hosts.namespace("robot")) as robot, datagram_socket(hosts.namespace("cloud")) as cloud:
            cloud.bind((CLOUD_ADDRESS, 20_000))
            robot.connect((CLOUD_ADDRESS, 20_000))
            took_ms = measure(robot, cloud, 1, 64)
            assert took_ms is not None
            assert took_ms >= 20.0
            hosts.cut("both")
            assert measure(robot, cloud, 2, 64) is None
            hosts.cut(None)
            assert measure(robot, cloud, 3, 64) is not None
        with datagram_socket("") as ours:  # this process has stayed on its own host
            ours.bind(("127.0.0.1", 0))
    assert not process.exists()
    names = subprocess.run(["ip", "netns"], capture_output=True, text=True, check=True).stdout
    assert "wire0" not in names
