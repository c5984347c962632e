"""Shared topics: what is our own is known when it comes back, others' goes on, frames have one parent."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.topics.shared import ECHO_S, TAKEN_S, Echoes, Loop
from robot_offload_core.words.declared import Frame
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.settings import OutputSpec
from tests.unit.core.topics.test_transforms import message, names

NOW_S = 100.0
TF = OutputSpec("tf", 0.0, shared=True, frames=(Frame("map", "odom"),))
OURS = ("map", "odom", 1, 0.5)
WHEELS = ("odom", "base_link", 1, 0.1)


def test_each_message_of_ours_is_known_once_when_it_comes_back() -> None:
    echoes = Echoes()
    for _ in range(2):
        echoes.put(b"same", NOW_S)
    assert [echoes.own(b"same", NOW_S) for _ in range(3)] == [True, True, False]
    assert not echoes.own(b"another", NOW_S)


def test_a_message_that_never_came_back_is_forgotten() -> None:
    echoes = Echoes()
    echoes.put(b"lost", NOW_S)
    assert not echoes.own(b"lost", NOW_S + ECHO_S + 0.1)
    assert not echoes.waiting


def test_a_tree_of_transforms_is_split_between_the_group_and_others() -> None:
    loop = Loop(TF)
    said = loop.replica(message([OURS, WHEELS]), NOW_S)
    assert said is not None
    assert names(said) == [("map", "odom")], "only declared frames go public"
    assert loop.undeclared == {"odom -> base_link"}
    others = loop.others(message([WHEELS, OURS]), NOW_S)
    assert others is not None
    assert names(others) == [("odom", "base_link")], "a frame has one parent, and it is the group's"


def test_a_standby_gets_only_frames_that_its_own_replica_does_not_publish() -> None:
    loop = Loop(TF)
    assert loop.holder(message([OURS]), NOW_S) == message([OURS]), "a sleeping replica publishes nothing"
    loop.replica(message([("map", "odom", 1, 0.6)]), NOW_S)
    assert loop.holder(message([OURS]), NOW_S + 0.1) is None, "a Hot one has a transform of its own"
    assert loop.holder(message([OURS]), NOW_S + 1.5) == message([OURS])


def test_a_standby_that_fell_asleep_gets_the_holders_frames_after_two_of_its_own_periods() -> None:
    loop = Loop(TF)
    for number in range(20):
        burst = 0.001 if number % 2 else 0.0  # two at once are no period
        assert loop.replica(message([OURS]), NOW_S + number * 0.05 + burst) is not None
    last_s = NOW_S + 19 * 0.05 + 0.001
    assert loop.holder(message([OURS]), last_s + 0.11) is None, "two periods and nothing: it may be late"
    assert loop.holder(message([OURS]), last_s + 0.2) == message([OURS])


def test_garbage_on_a_topic_of_transforms_goes_nowhere_and_is_counted() -> None:
    loop = Loop(TF)
    assert loop.others(b"\0\1\0\0\xff", NOW_S) is None
    assert loop.replica(b"", NOW_S) is None
    assert loop.strange == 2


def test_somebody_else_who_publishes_a_frame_of_the_group_is_named_with_the_side_until_that_is_over() -> None:
    loop = Loop(TF)
    loop.say(message([OURS]), NOW_S)
    loop.others(message([OURS]), NOW_S)
    loop.others(message([WHEELS]), NOW_S)
    assert loop.taken(Site.ROBOT, ["/wheels"], NOW_S) is None, (
        "the group's own word comes back, others' frames are theirs"
    )
    loop.others(message([WHEELS, OURS]), NOW_S)
    assert loop.taken(Site.ROBOT, ["/slam"], NOW_S) == (
        Problem.FRAME_TAKEN, "map -> odom of the group is published on tf on the robot also by /slam",
    )  # fmt: skip
    several = loop.taken(Site.CLOUD, ["/wheels", "/slam"], NOW_S)
    assert several is not None
    assert several[1].endswith("in the cloud also by one of /slam, /wheels")
    gone = loop.taken(Site.CLOUD, [], NOW_S)
    assert gone is not None
    assert gone[1].endswith("by a node that is gone")
    assert loop.taken(Site.ROBOT, ["/slam"], NOW_S + TAKEN_S + 1) is None
