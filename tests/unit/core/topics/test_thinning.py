"""What is said when a link does not carry all messages of an input."""

from robot_offload_core.topics.thinning import THINNING_WINDOW_S, Thinning


def said(offered: int, sent: int, *, connected: bool = True, slowest_s: float = 0.0) -> tuple[str, str] | None:
    one = Thinning(0.0)
    for number in range(offered):
        one.count(1_000_000 if number < sent else 0, sent=number < sent)
    assert not one.is_due(THINNING_WINDOW_S - 0.1)
    assert one.is_due(THINNING_WINDOW_S)
    return one.judge("camera", THINNING_WINDOW_S, connected=connected, slowest_s=slowest_s)


def test_rates_and_bytes_of_a_thinned_topic_are_said() -> None:
    found = said(50, 20)
    assert found is not None
    reason, message = found
    assert reason == "Thinned"
    assert "4.0 of 10.0 messages a second of camera (4.0 MB/s)" in message


def test_thinning_down_to_the_declared_rate_is_said_and_below_it_is_another_word() -> None:
    found = said(50, 20, slowest_s=0.5)
    assert found is not None
    assert found[0] == "Thinned"
    assert "4.0 of 10.0 messages a second" in found[1]
    assert "down to its minRate of 2" in found[1]
    found = said(50, 5, slowest_s=0.5)
    assert found is not None
    assert found[0] == "MinRateMissed"
    assert "fewer than its minRate of 2" in found[1]


def test_what_is_sent_later_counts_as_sent() -> None:
    one = Thinning(0.0)
    for _ in range(20):
        one.count(0, sent=False)
        one.count_later(1000)
    assert one.judge("camera", THINNING_WINDOW_S, connected=True) is None


def test_a_few_messages_that_a_full_queue_dropped_are_no_thinning() -> None:
    assert said(50, 45) is None
    assert said(5, 0) is None


def test_without_a_link_nothing_is_thinned() -> None:
    assert said(50, 0, connected=False) is None


def test_the_next_window_begins_anew() -> None:
    one = Thinning(0.0)
    for _ in range(20):
        one.count(0, sent=False)
    assert one.judge("camera", 5.0, connected=True) is not None
    for _ in range(20):
        one.count(10, sent=True)
    assert one.judge("camera", 10.0, connected=True) is None
