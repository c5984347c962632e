"""Messages larger than `maxMessageSize` do not cross, and the user hears which."""

from __future__ import annotations

from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.process import DataPlan, DataProcess, InputPlan, OutputPlan
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.fence.token import Token
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.messages import PASSED, Carried, Egress, Orders
from tests.unit.core.builders import CLOUD, ROBOT
from tests.unit.core.data.test_states import Ports

MOST = 100
PLAN = DataPlan((InputPlan("scan"),), (OutputPlan("plan", mirrored=True),), max_message_size=MOST)
FITS, TOO_LARGE = bytes(MOST), bytes(MOST + 1)


def said(data: DataProcess, name: str) -> str:
    reason, message = data.problems.get(f"size {name}", ("", ""))
    assert reason in ("", "MessageTooLarge")
    return message


def test_a_large_input_stays_on_the_robot_and_is_named_until_one_fits_again() -> None:
    ports = Ports()
    data = RobotDataProcess(PLAN, ports)
    data.handle(Orders(ROBOT, 1))
    data.forward("scan", TOO_LARGE)
    assert not ports.crossed
    assert data.counters["scan.too_large"] == 1
    assert "101 bytes" in said(data, "scan")
    data.forward("scan", FITS)
    assert len(ports.crossed) == 1
    assert said(data, "scan") == ""


def test_a_large_output_stays_on_its_side() -> None:
    ports = Ports()
    cloud = CloudDataProcess(PLAN, ports)  # type: ignore[arg-type]
    cloud.handle(Egress(CLOUD, ROBOT, SetEgress(Token(ROBOT, 1, CLOUD), ports.time_s + 1.0)))
    robot = RobotDataProcess(PLAN, ports)
    robot.handle(Orders(ROBOT, 1))
    for payload in (TOO_LARGE, FITS):
        cloud.leave(0, payload)
        robot.handle(Carried(PASSED, 0, b"header", payload))
    assert [channel for channel, _, _ in ports.crossed] == ["out/plan", "mirror/plan"]
    assert cloud.counters["plan.too_large"] == robot.counters["plan.too_large"] == 1
