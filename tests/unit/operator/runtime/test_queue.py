"""The queue: many events become one pass, passes of one name never overlap, failures come back ever later."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from robot_offload.runtime.queue import LONGEST_BACKOFF_S, Queue


class Clock:
    """A steady clock that a test turns."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def run(story: Callable[[Queue[str], Clock], Awaitable[None]]) -> None:
    async def main() -> None:
        clock = Clock()
        await story(Queue(clock, seed=1), clock)

    asyncio.run(main())


async def settle() -> None:
    """Let the workers do all that they can do now."""
    for _ in range(20):
        await asyncio.sleep(0)


def working(queue: Queue[str], look: Callable[[str], Awaitable[None]], workers: int = 2) -> list[asyncio.Task[None]]:
    return [asyncio.create_task(queue.work(look)) for _ in range(workers)]


async def end(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def test_what_a_person_changed_goes_before_everything_else_that_is_due() -> None:
    async def story(queue: Queue[str], _: Clock) -> None:
        seen: list[str] = []

        async def look(name: str) -> None:
            seen.append(name)

        for number in range(100):
            queue.add(str(number))
        queue.add("7", urgent=True)
        queue.add("new", urgent=True)
        tasks = working(queue, look, workers=1)
        async with asyncio.timeout(60):
            while len(seen) < 101:
                await asyncio.sleep(0.001)
        assert seen[:2] == ["7", "new"]
        assert sorted(seen) == sorted({*map(str, range(100)), "new"})
        await end(tasks)

    run(story)


def test_many_events_become_one_pass() -> None:
    async def story(queue: Queue[str], _: Clock) -> None:
        seen: list[str] = []

        async def look(name: str) -> None:
            seen.append(name)

        for _ in range(5):
            queue.add("a")
        queue.add("b")
        tasks = working(queue, look)
        await settle()
        assert sorted(seen) == ["a", "b"]
        assert len(queue) == 0
        await end(tasks)

    run(story)


def test_an_event_during_a_pass_means_one_more_pass_after_it_and_never_two_at_once() -> None:
    async def story(queue: Queue[str], _: Clock) -> None:
        passes: list[str] = []
        gate = asyncio.Event()

        async def look(name: str) -> None:
            passes.append("begin")
            await gate.wait()
            passes.append("end")

        queue.add("a")
        tasks = working(queue, look)
        await settle()
        queue.add("a")
        queue.add("a")
        await settle()
        assert passes == ["begin"]
        gate.set()
        await settle()
        assert passes == ["begin", "end", "begin", "end"]
        await end(tasks)

    run(story)


def test_a_delayed_item_waits_for_its_time_and_an_event_brings_it_forward() -> None:
    async def story(queue: Queue[str], clock: Clock) -> None:
        queue.remind("a", 100)
        assert len(queue) == 0
        queue.add("a", 5)
        clock.now_s = 5
        assert len(queue) == 1

    run(story)


def test_a_reminder_can_be_postponed_but_an_event_cannot() -> None:
    async def story(queue: Queue[str], clock: Clock) -> None:
        queue.remind("a", 10)
        queue.postpone("a", 30)
        queue.add("b", 10)
        queue.postpone("b", 30)
        queue.remind("c", 10)
        queue.add("c", 10)
        queue.postpone("c", 30)
        clock.now_s = 10
        assert len(queue) == 2
        clock.now_s = 30
        assert len(queue) == 3

    run(story)


def test_failures_come_back_ever_later_up_to_a_limit_and_at_least_when_the_server_says() -> None:
    async def story(queue: Queue[str], _: Clock) -> None:
        delays = [queue.retry("a") for _ in range(12)]
        assert delays[0] < 1 < delays[3] < delays[6]
        assert max(delays) <= LONGEST_BACKOFF_S * 1.25
        queue.forgive("a")
        assert queue.retry("a") < 1
        assert queue.retry("b", at_least_s=60) >= 60

    run(story)
