"""Handing over before a pod stops."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from robot_offload.api.agent_state import Sight, look
from robot_offload.reporter.handover import Answer, Handovers, Outcome, judge
from tests.unit.operator.reporter.states import seen, text


@pytest.mark.parametrize(
    ("sight", "outcome"),
    [
        (seen(100.0, handover="id"), Outcome.DONE),
        (seen(90.0, handover="id"), Outcome.DONE),  # it had answered before it fell silent
        (seen(90.0), Outcome.AGENT_SILENT),
        (Sight(), Outcome.AGENT_SILENT),
        (seen(100.0), None),
        (seen(100.0, handover="another"), None),
    ],
)
def test_a_handover_ends_with_the_agents_answer(sight: Sight, outcome: Outcome | None) -> None:
    answer = judge("id", sight, 101.0, 115.0)
    assert (answer.outcome if answer else None) is outcome


def test_a_living_agent_that_does_not_answer_is_too_late() -> None:
    answer = judge("id", seen(114.0), 115.0, 115.0)
    assert answer is not None
    assert answer.outcome is Outcome.TOO_LATE


class Agent:
    """What an agent does: it reads the file and says in its state that the robot acts."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.asked: list[str] = []

    def sight(self) -> Sight:
        identifier = self.file.read_text().strip() if self.file.exists() else ""
        if identifier and identifier not in self.asked:
            self.asked.append(identifier)
        return look(Sight(), text(handover=identifier), time.monotonic())


def test_requests_that_come_together_share_one_handover(tmp_path: Path) -> None:
    agent = Agent(tmp_path / "handover")

    async def ask_three_times_and_once_later() -> tuple[list[Answer], Answer]:
        handovers = Handovers(agent.file, agent.sight, time.monotonic)
        together = await asyncio.gather(*(handovers.hand_over() for _ in range(3)))
        return together, await handovers.hand_over()

    together, later = asyncio.run(ask_three_times_and_once_later())
    assert {answer.outcome for answer in (*together, later)} == {Outcome.DONE}
    assert len({answer.id for answer in together}) == 1
    assert agent.asked == [together[0].id, later.id]
    assert list(tmp_path.iterdir()) == [agent.file]  # no half-written file is left


def test_a_caller_that_hangs_up_does_not_end_the_handover_of_the_others(tmp_path: Path) -> None:
    agent, silent = Agent(tmp_path / "handover"), True

    def sight() -> Sight:
        return seen(time.monotonic()) if silent else agent.sight()

    async def one_hangs_up() -> Answer:
        nonlocal silent
        handovers = Handovers(agent.file, sight, time.monotonic)
        first, second = (asyncio.create_task(handovers.hand_over()) for _ in range(2))
        await asyncio.sleep(0)
        first.cancel()
        await asyncio.sleep(0)
        silent = False
        return await second

    assert asyncio.run(one_hangs_up()).outcome is Outcome.DONE
