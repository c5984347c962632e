"""How inputs are spread over a link that does not carry all of them."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from robot_offload_core.topics.pacing import CALM_S, Pace, Paces
from robot_offload_core.words.declared import Priority

PERIOD_S = 0.1


class NarrowLink:
    """Two inputs at 10 Hz each over a link that takes `carries` messages a second of both together."""

    def __init__(self, carries: float, **paces: Pace) -> None:
        self.paces = Paces(paces.items())
        self.carries = carries
        self.room = 1.0
        self.sent: dict[str, list[float]] = {name: [] for name in paces}
        self.refused: Counter[str] = Counter()
        self.now_s = 0.0

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += PERIOD_S
            self.room = min(2.0, self.room + PERIOD_S * self.carries)
            for name in self.sent:
                if not self.paces.passes(name, self.now_s):
                    continue
                if self.room < 1:
                    self.refused[name] += 1
                    self.paces.refused(name, self.now_s)
                else:
                    self.room -= 1
                    self.sent[name].append(self.now_s)

    def rate(self, name: str, over_s: float = 10.0) -> float:
        return sum(sent_s > self.now_s - over_s for sent_s in self.sent[name]) / over_s


def test_a_link_that_carries_all_thins_nothing() -> None:
    link = NarrowLink(30.0, scan=Pace(0.5), camera=Pace(0.5))
    link.run(20.0)
    assert link.rate("scan") == link.rate("camera") == 10.0
    assert not link.refused


def test_an_input_is_thinned_evenly_to_what_passes() -> None:
    link = NarrowLink(4.0, camera=Pace(1.0))
    link.run(40.0)
    assert 3.0 <= link.rate("camera") <= 4.2
    late = [sent_s for sent_s in link.sent["camera"] if sent_s > 20.0]
    assert max(b - a for a, b in pairwise(late)) <= 0.6, "no bursts and no holes"


def test_it_is_never_thinned_below_its_least_rate() -> None:
    link = NarrowLink(0.5, camera=Pace(0.5))
    link.run(30.0)
    offered = link.rate("camera") + link.refused["camera"] / 30.0
    assert offered >= 1.9
    assert link.paces.of["camera"].least_s == 0.5


def test_an_input_without_a_least_rate_is_sent_as_it_comes() -> None:
    link = NarrowLink(3.0, camera=Pace())
    link.run(20.0)
    assert len(link.sent["camera"]) + link.refused["camera"] == 200


def test_the_lowest_priority_is_thinned_first() -> None:
    link = NarrowLink(12.0, scan=Pace(0.5, Priority.HIGH), camera=Pace(1.0, Priority.LOW))
    link.run(40.0)
    assert link.rate("scan") >= 9.0
    assert 1.0 <= link.rate("camera") <= 3.5


def test_it_comes_as_before_when_the_link_is_wide_again() -> None:
    link = NarrowLink(4.0, camera=Pace(1.0))
    link.run(20.0)
    assert link.paces.of["camera"].least_s > 0.15
    link.carries = 30.0
    link.run(20 * CALM_S)
    assert link.rate("camera", 5.0) == 10.0
    assert link.paces.of["camera"].least_s == 0.0


def test_a_burst_after_a_pause_is_thinned_too() -> None:
    pace = Pace(1.0)
    for number in range(10):
        pace.passes(number * 0.1)
    pace.slow(1.0)
    assert pace.passes(1.0)
    assert not pace.passes(1.02), "the next one is early"
    pace.slow(59.99)
    passed = [pace.passes(60.0 + number * 0.001) for number in range(10)]
    assert sum(passed) <= 2
