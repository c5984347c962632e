"""The rules at the consumer, which judge every test with real agents: what they forgive and what they never do."""

from dataclasses import replace

import pytest

from robot_offload_lab.judge.recording import Arrival, PlacementChange, Site
from tests.ros.agent.passage import holes, longest_gap_s, violations

OLD, NEW = "old", "new"


def robot(t_s: float, sequence: int = 1, age_s: float = 0.01) -> Arrival:
    return Arrival("/walk", t_s, "walker.1", sequence, t_s - age_s, "robot")


def cloud(t_s: float, sequence: int = 1, age_s: float = 0.01) -> Arrival:
    return Arrival("/walk", t_s, "remote_walker.2", sequence, t_s - age_s, "cloud")


def said(t_s: float, site: Site, control: str = OLD) -> PlacementChange:
    return PlacementChange(t_s, site, 1, "Reason", "message", phase=site.capitalize(), control=control)


def test_a_change_that_was_announced_is_none_to_complain_of() -> None:
    placed = [said(0.0, "robot"), said(10.0, "cloud")]
    assert not violations([robot(9.9), cloud(10.0)], placed, 0.25)


def test_a_change_that_nobody_announced_is_told() -> None:
    placed = [said(0.0, "robot"), said(10.0, "cloud")]
    (found,) = violations([robot(20.0), cloud(20.1)], placed, 0.25)
    assert "no switch was announced" in found


def test_both_sides_mixed_around_one_announcement_are_told() -> None:
    placed = [said(0.0, "robot"), said(10.0, "cloud")]
    mixed = [robot(9.9), cloud(10.0), robot(10.1, 2), cloud(10.2, 2)]
    assert len(violations(mixed, placed, 0.25)) == 2


def test_a_control_that_begins_anew_has_put_the_robot_in_charge_however_late_its_first_word_was_heard() -> None:
    placed = [said(0.0, "cloud"), said(19.0, "cloud", NEW)]
    assert not violations([cloud(9.9), robot(10.7), cloud(19.0, 2)], placed, 0.25, begun_s=[10.0])


def test_a_control_that_begins_anew_explains_nothing_that_passed_before_it_began() -> None:
    placed = [said(0.0, "cloud"), said(19.0, "cloud", NEW)]
    assert violations([cloud(5.0), robot(5.1), cloud(19.0, 2)], placed, 0.25, begun_s=[10.0])


def test_a_control_that_begins_anew_explains_one_change_only() -> None:
    placed = [said(0.0, "cloud"), said(12.0, "cloud", NEW)]
    mixed = [cloud(9.9), robot(10.7), cloud(11.0, 2), robot(11.1, 2), cloud(12.0, 3)]
    assert violations(mixed, placed, 0.25, begun_s=[10.0])


def test_a_preparation_that_is_called_off_explains_one_stay_of_the_cloud_and_no_second() -> None:
    to_cloud = replace(said(9.5, "robot"), phase="ToCloud")
    placed = [said(0.0, "robot"), to_cloud, said(10.0, "robot")]
    once = [robot(9.9), cloud(10.0), robot(10.05, 2)]
    assert not violations(once, placed, 0.25)
    assert len(violations([*once, cloud(10.1, 2), robot(10.15, 3)], placed, 0.25)) == 2
    assert violations([robot(20.0), cloud(20.1), robot(20.2, 2)], placed, 0.25)


@pytest.mark.parametrize(("second", "word"), [(1, "came twice"), (0, "came after")])
def test_a_message_that_comes_twice_or_late_is_told(second: int, word: str) -> None:
    (found,) = violations([robot(1.0, 1, age_s=0.01), robot(1.1, second, age_s=0.2)], [said(0.0, "robot")], 0.25)
    assert word in found


def test_an_old_message_of_the_cloud_is_told_and_one_of_the_robot_is_not() -> None:
    placed = [said(0.0, "cloud")]
    assert "is older than" in violations([cloud(1.0, age_s=0.3)], placed, 0.25)[0]
    assert not violations([robot(1.0, age_s=0.3)], [said(0.0, "robot")], 0.25)


def test_a_silent_producer_is_no_gap_but_its_late_message_is() -> None:
    assert longest_gap_s([robot(1.0, 1), robot(3.0, 2)], 0.9) == pytest.approx(0.1)
    assert longest_gap_s([robot(1.0, 1), robot(3.0, 2, age_s=1.5)], 0.9) == pytest.approx(1.5)


def test_a_lost_message_and_a_change_of_the_producer_are_gaps_in_full() -> None:
    assert longest_gap_s([robot(1.0, 1), robot(3.0, 3)], 0.9) == pytest.approx(2.0)
    assert longest_gap_s([robot(1.0, 1), cloud(3.0, 2)], 0.9) == pytest.approx(2.0)
    assert holes([robot(1.0, 1), robot(3.0, 3)]) == 1


def test_nothing_at_all_is_an_endless_gap() -> None:
    assert longest_gap_s([robot(1.0)], 1.0) == float("inf")
