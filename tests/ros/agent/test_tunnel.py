"""The tunnel between two network namespaces: what TCP by itself would wait for or never come back from."""

import datetime
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robot_offload.transport import dds_router, tunnel
from robot_offload_lab.run.certificates import make_certificates
from tests.ros.agent.ears import wait_until
from tests.ros.agent.namespaces import ADDRESSES, Namespaces, ip
from tests.ros.agent.processes import Processes

NEAR = str(Path(__file__).with_name("near.py"))
ROBOT, CLOUD = (address.partition("/")[0] for address in ADDRESSES.values())
PATIENCE_S = 60.0
"""Of a busy machine; an idle one needs less than two seconds."""


class Link:
    """Both ends of the tunnel, and who talks through it."""

    def __init__(self, folder: Path, namespaces: Namespaces) -> None:
        self.namespaces = namespaces
        self.robot = namespaces.name("robot")
        self.processes = Processes(folder, {})
        now = datetime.datetime.now(datetime.timezone.utc)
        made = make_certificates(folder / "pki", robot="r1", host_names=[CLOUD], now=now)
        proof = [
            tunnel.Proof(*map(str, (one.ca, one.certificate, one.private_key))) for one in (made.robot, made.cloud)
        ]
        self.files = {"robot": folder / "robot.yaml", "cloud": folder / "cloud.yaml"}
        ends = (
            tunnel.robot_end("127.0.0.1:11667", [f"{CLOUD}:11666"], proof[0], verify_name=True),
            tunnel.cloud_end("0.0.0.0:11666", "127.0.0.1:11668", proof[1], "r1"),
        )
        for file, document in zip(self.files.values(), ends, strict=True):
            file.write_text(dds_router.text(document), encoding="utf-8")

    def start(self) -> None:
        for side, port in (("cloud", "11668"), ("robot", "11667")):
            command = [sys.executable, "-m", "robot_offload_agent.tunnel.main", "--params", str(self.files[side])]
            self.processes.start(f"{side}-tunnel", command, self.namespaces.name(side))
            self.processes.start(f"{side}-near", [sys.executable, NEAR, side, port], self.namespaces.name(side))

    def answers(self) -> int:
        return self.processes.log("robot-near").count("answered")

    def comes_back(self, heal: Callable[[], object]) -> None:
        """Heals the link and waits for answers to what was sent afterwards."""
        heal()
        before = self.answers()
        assert wait_until(lambda: self.answers() > before + 20, PATIENCE_S), self.processes.logs()


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Link]:
    namespaces = Namespaces()
    namespaces.make()
    link = Link(tmp_path, namespaces)
    try:
        yield link
    finally:
        left = link.processes.close()
        namespaces.remove()
        assert not left


def test_a_robot_that_starts_without_a_network_comes_in_and_comes_back_whatever_happens_to_the_link(link: Link) -> None:
    ip("-n", link.robot, "link", "set", "link0", "down")
    link.start()
    wait_until(lambda: False, 1.5)
    link.comes_back(lambda: ip("-n", link.robot, "link", "set", "link0", "up"))

    link.namespaces.cut("both")
    wait_until(lambda: False, 4.0)
    link.comes_back(lambda: link.namespaces.cut(None))

    ip("-n", link.robot, "address", "del", f"{ROBOT}/24", "dev", "link0")
    link.comes_back(lambda: ip("-n", link.robot, "address", "add", "10.77.0.9/24", "dev", "link0"))
