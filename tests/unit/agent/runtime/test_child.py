"""One child of the supervisor: which silence counts, and how often."""

from robot_offload_agent.runtime.child import Child


def silent_child() -> Child:
    child = Child("one", lambda: None, hung_s=2.0)
    child.begin(7, 0.0)
    child.sign(1.0)
    return child


def test_a_process_that_hangs_counts_once_although_its_old_signs_arrive_while_it_is_being_killed() -> None:
    child = silent_child()
    assert child.silent_s(3.5) > 0
    child.give_up(3.5)
    child.sign(1.0)  # sent before it was killed, read after
    assert child.silent_s(3.6) < 0
    child.end(3.7, -9)
    assert (child.deaths, child.hangs) == (1, 1)


def test_a_process_that_does_not_die_is_killed_again_and_hung_once() -> None:
    child = silent_child()
    child.give_up(3.5)
    assert child.silent_s(5.6) > 0
    child.give_up(5.6)
    assert child.hangs == 1


def test_the_next_life_is_believed_again() -> None:
    child = silent_child()
    child.give_up(3.5)
    child.end(3.6, -9)
    child.begin(8, 4.0)
    child.sign(5.0)
    assert child.silent_s(6.0) < 0
    assert child.silent_s(7.5) > 0
