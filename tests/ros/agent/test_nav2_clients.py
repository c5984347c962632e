"""Nav2's own clients cannot tell that their server moved, and its servers preempt and abort as they do without us."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from tests.ros.agent.clients import ABORTED, CANCELED, SUCCEEDED
from tests.ros.agent.harness import World
from tests.ros.agent.nav2_clients import SERVER_TIMEOUT_S, BasicNavigator, TreeNode

PATIENCE_S = 60.0
"""A busy machine may be late, and one that stands still later."""
RENEWED_S = 1.0


def goes_forward(feedback: Sequence[tuple[int, int, int]]) -> None:
    """No goal is heard after a later one; within a turn of one process the ticks of a goal grow."""
    for (*before, tick), (*after, next_tick) in itertools.pairwise(feedback):
        assert after[0] >= before[0], f"goal {after[0]} after goal {before[0]}"
        assert after != before or next_tick > tick, f"{next_tick} after {tick} of {after}"


def test_a_navigator_polls_cancels_and_drives_on_through_switches(serving_world: World) -> None:
    with BasicNavigator(serving_world.domain["robot"], "basic_navigator") as navigator:
        assert navigator.go(400)
        polls = 0
        for side in ("robot", "cloud", "robot"):
            serving_world.place(side, stay=True)
            heard = len(navigator.feedback)
            while len(navigator.feedback) < heard + 5:
                assert not navigator.is_task_complete()
                polls += 1
        assert polls > 0
        assert navigator.result() == SUCCEEDED
        executors = iter([process for process, _ in itertools.groupby(turn[1] for turn in navigator.feedback)])
        # On a busy machine it may have moved more often.
        assert all(serving_world.nodes[side].pid in executors for side in ("cloud", "robot", "cloud", "robot"))
        goes_forward(navigator.feedback)
        assert navigator.go(10_000)
        assert not navigator.is_task_complete()
        navigator.cancel_task()
        assert navigator.result() == CANCELED
        assert navigator.go(5)
        assert navigator.result() == SUCCEEDED
    assert navigator.results == [SUCCEEDED, CANCELED, SUCCEEDED]


def test_a_tree_renews_its_path_each_second_through_switches_and_a_loss_and_is_halted(serving_world: World) -> None:
    with TreeNode(serving_world.domain["robot"], "follow_path") as tree:
        turns = ("cloud", "robot", "cloud", "cut")
        for turn in turns:
            tree.renew(10_000, PATIENCE_S)
            tree.tick(RENEWED_S / 2)
            if turn == "cut":
                serving_world.cut("both")
                serving_world.goes_to("robot")
                serving_world.cut(None)
            else:
                serving_world.place(turn, stay=True)
            tree.tick(RENEWED_S / 2)
            heard = len(tree.feedback)
            while len(tree.feedback) < heard + 5:
                tree.tick(0.1)
            assert not tree.asked[-1].done(), "the newest goal goes on"
        tree.renew(10_000, PATIENCE_S)
        tree.tick(0.2)
        assert tree.halt() == CANCELED
        while None in tree.results:
            tree.executor.spin_once(0.1)
        goes_forward(tree.feedback)
    assert tree.results == [ABORTED] * len(turns) + [CANCELED]
    # Each that comes from the relay itself is quick: none has to wait for a server on the other side. Beside two
    # processes that never rest the quickest of five took 0.5 to 2 ms, so one that takes 20 ms says something.
    assert min(tree.acknowledged_s) < SERVER_TIMEOUT_S


def test_a_goal_that_waits_for_the_one_before_ends_when_a_third_comes(serving_world: World) -> None:
    with TreeNode(serving_world.domain["robot"], "impatient") as tree:
        for _ in range(3):
            tree.renew(10_000, PATIENCE_S)
        tree.tick(0.3)
        assert not tree.asked[-1].done()
        assert tree.halt() == CANCELED
        while None in tree.results:
            tree.executor.spin_once(0.1)
    assert tree.results == [ABORTED, ABORTED, CANCELED]
