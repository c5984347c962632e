"""A policy sees what has arrived, at the moment at which it arrives, and never the future."""

from __future__ import annotations

import pytest

from robot_offload.errors import InputError
from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay.contract import Decision
from robot_offload_lab.replay.costs import Change
from robot_offload_lab.replay.named import POLICIES
from robot_offload_lab.replay.play import moments, play
from tests.unit.lab.replay.cases import Script, beats_of, link, text


def test_a_policy_is_asked_at_each_beat_and_at_each_arrival() -> None:
    script = Script()
    play(script, beats_of(text(*[33] * 3)))
    assert script.asked == pytest.approx([0, 0.02, 0.033, 0.04, 0.053, 0.06])
    assert script.echoes == [(0.0, 0.033), (0.02, 0.053)]


def test_an_echo_that_arrives_with_a_beat_is_read_before_the_question() -> None:
    found = dict(moments(beats_of(text(*[20] * 4))))
    assert found == {0: [], 20_000: [0], 40_000: [1], 60_000: [2]}


def test_what_a_stall_releases_together_is_read_together() -> None:
    found = dict(moments(beats_of(text(20, 20, 90, 20, 20))))
    assert found[130_000] == [2, 3, 4, 5, 6], "beats sent at 40 to 120 ms, held until 130 ms"
    assert [at_us for at_us, echoes in found.items() if not echoes] == [0, 60_000, 80_000, 100_000, 120_000, 140_000]


def test_lost_beats_are_never_heard() -> None:
    script = Script()
    play(script, beats_of(link((0.1, 10), (0.1, None), (0.12, 10))))
    assert [round(sent_s * 1e3) for sent_s, _ in script.echoes] == [0, 20, 40, 60, 80, 200, 220, 240, 260, 280]


def test_echoes_come_in_order_and_never_before_their_time() -> None:
    class Witness(Script):
        def place(self, now_s: float) -> Site:
            assert all(arrived_s <= now_s for _, arrived_s in self.echoes)
            return super().place(now_s)

    witness = Witness()
    play(witness, beats_of(text(20, 80, 300, 40, 500, 10, 10, 10, 120, 10)))
    assert witness.echoes == sorted(witness.echoes)
    assert witness.asked == sorted(set(witness.asked))


@pytest.mark.parametrize("name", POLICIES)
def test_the_future_changes_no_decision_of_the_past(name: str) -> None:
    past = [(3.0, 10.0), (0.3, 300.0), (2.0, 10.0), (0.1, None), (2.5, 10.0)]
    calm = beats_of(link(*past, (4.0, 10.0)))
    rough = beats_of(link(*past, (2.0, None), (2.0, 500.0)))
    until_us = 7_900_000
    seen = [
        [change for change in play(POLICIES[name].make(Settings()), beats) if change.at_us < until_us]
        for beats in (calm, rough)
    ]
    assert seen[0] == seen[1]


def test_the_changes_keep_moment_side_and_reason() -> None:
    class Reasons(Script):
        def place(self, now_s: float) -> Decision | str:  # type: ignore[override]
            return Decision(Site.CLOUD, "Because", "it is so") if now_s >= 0.04 else "robot"

    assert play(Reasons(), beats_of(text(*[20] * 9))) == (Change(40_000, Site.CLOUD, "Because", "it is so"),)


def test_a_side_may_be_told_as_a_word() -> None:
    class Words(Script):
        def place(self, now_s: float) -> str:  # type: ignore[override]
            return "Cloud"

    assert play(Words(), beats_of(text(*[20] * 9))) == (Change(0, Site.CLOUD),)


def test_an_answer_that_is_no_side_is_told() -> None:
    class Wrong(Script):
        def place(self, now_s: float) -> str:  # type: ignore[override]
            return "yes"

    with pytest.raises(InputError, match="the policy answered 'yes'; place must return 'robot' or 'cloud'"):
        play(Wrong(), beats_of(text(*[20] * 9)))


def test_progress_counts_every_thousand_beats() -> None:
    told: list[int] = []
    play(Script(), beats_of(link((50.0, 10))), told.append)
    assert told == [1000, 1000]
