"""The alarm of the pulse's main thread, which the link's thread puts off."""

import threading
import time
from collections.abc import Iterator

import pytest

from robot_offload_agent.runtime.alarm import Alarm
from robot_offload_agent.runtime.clock import now_s

PATIENCE_S = 60.0


@pytest.fixture
def alarm() -> Iterator[Alarm]:
    made = Alarm()
    yield made
    made.close()


def test_a_time_that_has_passed_rings_at_once_and_only_once(alarm: Alarm) -> None:
    alarm.set(now_s() - 5)
    assert alarm.wait(PATIENCE_S)
    assert not alarm.wait(0.0)


def test_it_rings_at_its_time_and_not_before(alarm: Alarm) -> None:
    at_s = now_s() + 0.05
    alarm.set(at_s)
    assert alarm.wait(PATIENCE_S)
    assert now_s() >= at_s


def test_nothing_rings_that_was_never_set(alarm: Alarm) -> None:
    assert not alarm.wait(0.01)


def test_another_thread_puts_it_off_while_it_is_waited_for(alarm: Alarm) -> None:
    alarm.set(now_s() + 1000)
    rung: list[bool] = []
    waiting = threading.Thread(target=lambda: rung.append(alarm.wait(PATIENCE_S)))
    waiting.start()
    alarm.set(now_s() + 2000)
    time.sleep(0.05)
    assert rung == []
    alarm.set(now_s() + 0.01)
    waiting.join(PATIENCE_S)
    assert rung == [True]
