"""The last seconds in memory: bounded, and cut around changeovers."""

from robot_offload_agent.record.mcap.ring import MAX_WINDOWS, OVERHEAD_BYTES, Changeover, Entry, Ring


def entry(at_s: float, size: int = 10, topic: str = "/a", latched: bool = False) -> Entry:
    return Entry(at_s, int(at_s * 1e9), topic, "std_msgs/msg/String", b"x" * size, latched)


def changeover(at_s: float) -> Changeover:
    return Changeover(at_s, int(at_s * 1e9), "robot", 1, "HeartbeatLost")


def filled(ring: Ring, until_s: int, begin_at_s: int | None = None) -> Ring:
    for second in range(until_s):
        ring.add(entry(float(second)))
        if second == begin_at_s:
            ring.begin(changeover(float(second)))
    return ring


def test_a_window_has_the_time_before_and_after_its_changeover() -> None:
    ring = filled(Ring(20, 10, 1 << 20), 74, begin_at_s=60)
    assert ring.due(69.9) == []
    [window] = ring.due(73)
    assert [each.at_s for each in window.entries] == [float(at) for at in range(40, 71)]
    assert not window.cut
    assert ring.due(1000) == []


def test_memory_is_bounded_and_the_window_says_what_is_gone() -> None:
    ring = Ring(20, 10, 5 * (10 + OVERHEAD_BYTES))
    filled(ring, 60)
    ring.begin(changeover(59))
    [window] = ring.due(69)
    assert [each.at_s for each in window.entries] == [55.0, 56.0, 57.0, 58.0, 59.0]
    assert window.cut


def test_a_message_that_is_larger_than_the_ring_is_counted_and_drives_nothing_out() -> None:
    ring = Ring(20, 10, 5000)
    ring.add(entry(1))
    ring.add(entry(2, size=6000))
    ring.begin(changeover(3))
    [window] = ring.due(13)
    assert ([each.at_s for each in window.entries], window.cut, ring.left_out) == ([1.0], True, 1)


def test_what_held_at_the_beginning_is_part_of_the_window() -> None:
    ring = Ring(5, 5, 1 << 20)
    ring.add(entry(0, topic="/state", latched=True))
    ring.add(entry(1, topic="/state", latched=True))
    for second in range(2, 50):
        ring.add(entry(float(second)))
    ring.begin(changeover(47))
    [window] = ring.due(52)
    first, *rest = window.entries
    assert (first.topic, first.at_s) == ("/state", 1.0)
    assert first.stamp_ns == rest[0].stamp_ns == 42_000_000_000


def test_changeovers_that_follow_each_other_have_a_window_each() -> None:
    ring = Ring(5, 5, 1 << 20)
    ring.begin(changeover(1))
    ring.begin(changeover(3))
    ring.add(entry(4))
    assert [len(window.entries) for window in ring.due(8)] == [1, 1]


def test_a_storm_of_changeovers_opens_so_many_windows_and_no_more() -> None:
    ring = Ring(5, 5, 1 << 20)
    opened = [ring.begin(changeover(0.1 * number)) for number in range(50)]
    assert opened.count(True) == MAX_WINDOWS
    assert ring.left_out == 50 - MAX_WINDOWS


def test_an_idle_ring_gives_nothing() -> None:
    assert Ring(5, 5, 1 << 20).due(float("inf")) == []


def test_at_the_end_open_windows_are_given_as_far_as_they_go() -> None:
    ring = Ring(5, 5, 1 << 20)
    ring.add(entry(1))
    ring.begin(changeover(1))
    assert [len(window.entries) for window in ring.due(float("inf"))] == [1]
