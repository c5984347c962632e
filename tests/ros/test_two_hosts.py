"""Two hosts on one machine, made of network namespaces: what passes between them passes through the emulated link."""

from __future__ import annotations

import itertools
import subprocess
from pathlib import Path

import pytest

from robot_offload_lab.bench.parts.hop import datagram_socket, measure
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.two_hosts import CLOUD_ADDRESS, TwoHosts

TRIES = 10


@pytest.mark.skipif(bool(TwoHosts.refusal()), reason=TwoHosts.refusal() or "-")
def test_two_hosts_hear_each_other_through_the_link_alone_and_leave_nothing():
    with TwoHosts(LinkOptions(delay="20ms"), 1) as hosts:
        process = Path(f"/proc/{hosts.pid}")
        with datagram_socket(hosts.namespace("robot")) as robot, datagram_socket(hosts.namespace("cloud")) as cloud:
            cloud.bind((CLOUD_ADDRESS, 20_000))
            robot.connect((CLOUD_ADDRESS, 20_000))
            numbers = itertools.count(1)

            def crossed() -> float | None:
                """Tries some times: what a busy machine delays for a second counts as lost."""
                return next(filter(None, (measure(robot, cloud, next(numbers), 64) for _ in range(TRIES))), None)

            took_ms = crossed()
            assert took_ms is not None
            assert took_ms >= 20.0
            hosts.cut("both")
            assert measure(robot, cloud, next(numbers), 64) is None
            hosts.cut(None)
            assert crossed() is not None
        with datagram_socket("") as ours:  # this process has stayed on its own host
            ours.bind(("127.0.0.1", 0))
    assert not process.exists()
    names = subprocess.run(["ip", "netns"], capture_output=True, text=True, check=True).stdout
    assert "wire0" not in names
