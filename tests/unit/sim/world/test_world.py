"""What waits for a process that is stopped in the simulated world."""

from collections.abc import Callable

from robot_offload_sim.world.world import REPLIES_KEPT, Host, Process, World


class Listener(Process):
    """A process that does nothing of its own."""

    def boot(self) -> None:
        """Has no timers."""


def stopped() -> tuple[World, Listener]:
    world = World("a seed")
    world.inbox_limit = 2
    listener = Listener(world, Host(world, "robot"), "relay")
    listener.start()
    listener.stop()
    return world, listener


def heard_after(world: World, listener: Listener, send: Callable[[Callable[[int], None], int], None]) -> list[int]:
    heard: list[int] = []
    for number in range(REPLIES_KEPT + 5):
        send(heard.append, number)
    world.run(1.0)
    listener.resume()
    return heard


def test_datagrams_beyond_the_inbox_of_a_stopped_process_are_lost() -> None:
    world, listener = stopped()
    assert heard_after(world, listener, lambda act, number: listener.post("data", act, number)) == [0, 1]


def test_answers_of_servers_wait_in_the_history_of_the_middleware_and_not_in_the_inbox() -> None:
    world, listener = stopped()
    listener.post("data", lambda: None)
    listener.post("data", lambda: None)
    kept = heard_after(world, listener, lambda act, number: listener.reply("node", "/dock/get_result", act, number))
    assert kept == list(range(REPLIES_KEPT))


def test_answers_leave_the_inbox_to_datagrams() -> None:
    world, listener = stopped()
    heard: list[str] = []
    listener.reply("node", "/dock/get_result", heard.append, "answer")
    for word in ("first", "second", "third"):
        listener.post("data", heard.append, word)
    world.run(1.0)
    listener.resume()
    assert sorted(heard) == ["answer", "first", "second"]
