"""Made-up links: the same seed gives the same link, two seeds two links of a kind, and the prior is what they teach."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload_core.prior import PRIOR
from robot_offload_lab.links.made_up import FAMILIES, made, main
from robot_offload_lab.links.recorded import load_trace
from robot_offload_lab.replay.learn import costs, learnt
from tests.unit.lab.replay.cases import ROOT, made_case


@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_makes_one_link(family: str) -> None:
    assert made(family, 3, 60.0) == made(family, 3, 60.0)
    assert made(family, 3, 60.0).rtts_ms != made(family, 4, 60.0).rtts_ms


@pytest.mark.parametrize("family", FAMILIES)
def test_a_link_is_good_enough_for_a_part_of_the_time(family: str) -> None:
    share = [
        made_case(made(family, seed, 300.0), FAMILIES[family].tolerance_s).beats.good(10**9).mean() for seed in (1, 2)
    ]
    assert all(0.2 < each <= 1 for each in share)


def test_whole_families_are_held_out() -> None:
    assert {name for name, family in FAMILIES.items() if family.held_out} == {
        "repeater", "tunnel", "interference", "satellite"
    }  # fmt: skip


def test_a_link_can_be_written_and_read_again(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    assert main(["tunnel", "--seed", "2", "--duration", "120", str(file)]) == 0
    assert file.read_text().startswith("# Made up: tunnel --seed 2 --duration 120.")
    assert load_trace(file).rtts_ms == made("tunnel", 2, 120.0).rtts_ms


def test_the_figure_of_a_rule_is_how_dear_it_is_beside_the_best_fixed_one() -> None:
    subject = made_case(made("periodic", 1, 120.0))
    found, best = costs(subject), subject.best_fixed.cost
    assert len(found) == len(PRIOR)
    figures = learnt([subject])
    dearest, cheapest = found.index(max(found)), found.index(min(found))
    assert figures[dearest] == max(figures)
    assert figures[cheapest] == min(figures)
    assert (figures[cheapest] < 0) is (found[cheapest] < best)


@pytest.mark.parametrize(("family", "seed"), [("roaming", 5), ("interference", 1), ("periodic", 1)])
def test_the_examples_are_what_their_first_line_says(family: str, seed: int, tmp_path: Path) -> None:
    file = tmp_path / "again.csv"
    main([family, "--seed", str(seed), "--duration", "120", str(file)])
    assert file.read_text() == (ROOT / "examples" / "traces" / f"{family}.csv").read_text()
