"""What is asked of a robot's wire, and what its link then does to frames. Without any interface."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from robot_offload_lab.cluster.wire_process import BUFFER_MS, Steering
from robot_offload_lab.wire.model import WireError
from robot_offload_lab.wire.options import LinkOptions


@pytest.fixture
def steering() -> Steering:
    return Steering(seed=1)


def arrival(steering: Steering, now_s: float, size: int = 100) -> float | None:
    steering.settle(now_s)
    return steering.link.datagram("up", now_s, size)


def test_a_frame_arrives_after_the_delay_and_overtakes_none(steering: Steering) -> None:
    steering.obey({"set": {"delay_ms": 20.0}}, 1.0)
    assert arrival(steering, 1.0) == pytest.approx(1.02)
    steering.obey({"set": {"delay_ms": 0.0}}, 1.0)
    assert arrival(steering, 1.001) == pytest.approx(1.02)


@pytest.mark.parametrize(("cut", "passes"), [(None, True), ("both", False), ("to_cloud", False), ("to_robot", True)])
def test_a_cut_holds_one_way_or_both(steering: Steering, cut: str | None, passes: bool) -> None:
    steering.obey({"set": {"cut": cut}}, 1.0)
    assert (arrival(steering, 1.0) is not None) is passes


def test_losses_come_as_often_as_set_and_are_counted(steering: Steering) -> None:
    steering.obey({"set": {"loss_pct": 30.0}}, 1.0)
    lost = sum(arrival(steering, 1.0) is None for _ in range(10_000))
    assert 2700 < lost < 3300
    assert steering.obey({}, 1.0)["frames"] == {"to_cloud": [10_000 - lost, lost], "to_robot": [0, 0]}


def test_a_limited_rate_lets_frames_wait_and_drops_what_would_wait_too_long(steering: Steering) -> None:
    steering.obey({"set": {"rate_kbit": 80.0}}, 1.0)  # 10 bytes a millisecond
    assert arrival(steering, 1.0, 1000) == pytest.approx(1.1)
    waiting = [arrival(steering, 1.0, 1000) for _ in range(10)]
    assert max(each for each in waiting if each is not None) <= 1.0 + BUFFER_MS / 1e3 + 0.1 + 1e-9
    assert None in waiting


def test_a_recording_plays_once_with_the_losses_that_are_set(steering: Steering, tmp_path: Path) -> None:
    trace = tmp_path / "trace.txt"
    trace.write_text("20\n" * 4 + "1000\n" + "20\n" * 4)
    steering.obey({"set": {"delay_ms": 3.0}}, 100.0)
    assert steering.obey({"play": str(trace)}, 100.0)["playing"]
    assert arrival(steering, 100.0) == pytest.approx(100.01)
    assert arrival(steering, 100.5) == pytest.approx(101.08)  # held to the end of the stall
    assert arrival(steering, 101.1) == pytest.approx(101.11)
    steering.settle(101.2)
    assert not steering.obey({}, 101.2)["playing"]
    assert arrival(steering, 101.2) == pytest.approx(101.203)


def test_a_link_is_quiet_until_its_schedule_starts_and_when_it_is_followed_anew(steering: Steering) -> None:
    link = LinkOptions(delay="5ms", outages=("1/4",))
    steering.obey({"follow": json.loads(json.dumps(asdict(link)))}, 10.0)
    assert arrival(steering, 13.5) == pytest.approx(13.505)
    assert steering.obey({"start": True}, 20.0)["started_s"] == 20.0
    assert arrival(steering, 22.9) == pytest.approx(22.905)
    assert arrival(steering, 23.5) is None
    steering.obey({"follow": json.loads(json.dumps(asdict(link)))}, 24.0)
    assert arrival(steering, 27.5) == pytest.approx(27.505)


def test_what_is_set_comes_on_top_of_a_link_that_is_followed(steering: Steering) -> None:
    link = json.loads(json.dumps(asdict(LinkOptions(delay="5ms"))))
    steering.obey({"follow": link}, 10.0)
    steering.obey({"start": True}, 10.0)
    steering.obey({"set": {"cut": "to_cloud"}}, 10.0)
    assert arrival(steering, 11.0) is None
    assert steering.link.datagram("down", 11.0, 100) == pytest.approx(11.005)
    steering.obey({"set": {"cut": None}}, 11.0)
    assert arrival(steering, 12.0) == pytest.approx(12.005)
    steering.obey({"set": {"delay_ms": 30.0}}, 12.0)
    assert arrival(steering, 13.0) == pytest.approx(13.030)
    steering.obey({"follow": link}, 14.0)
    assert arrival(steering, 15.0) == pytest.approx(15.005)


@pytest.mark.parametrize(
    "order",
    [{"set": {"speed": 1}}, {"set": {"loss_pct": 200}}, {"set": {"cut": "half"}}, {"follow": {"delay": "soon"}}],
)
def test_an_order_that_makes_no_sense_changes_nothing(steering: Steering, order: dict[str, object]) -> None:
    before = steering.obey({}, 1.0)
    with pytest.raises((WireError, TypeError)):
        steering.obey(order, 1.0)
    assert steering.obey({}, 1.0) == before
