"""Made-up links: the same seed gives the same link, two seeds two links of a kind, and the prior is what they teach."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload_core.link.prior import PRIOR
from robot_offload_lab.links.made_up import FAMILIES, SCENES, made, main
from robot_offload_lab.links.recorded import load_trace, parse_trace
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


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (["roaming", "--seed", "5", "--duration", "120"], "roaming.csv"),
        (["interference", "--seed", "1", "--duration", "120"], "interference.csv"),
        (["periodic", "--seed", "1", "--duration", "120"], "periodic.csv"),
        (["corridor-wifi", "--seed", "7", "--duration", "60"], "corridor-wifi.txt"),
        (["yard-4g", "--seed", "11", "--duration", "180"], "yard-4g.csv"),
    ],
)
def test_the_examples_are_what_their_first_line_says(arguments: list[str], name: str, tmp_path: Path) -> None:
    examples = ROOT / "examples" / "traces"
    assert main([*arguments, str(tmp_path / name)]) == 0
    assert (tmp_path / name).read_bytes() == (examples / name).read_bytes()
    assert (examples / name).read_text().startswith(f"# Made up: {' '.join(arguments)}.")
    assert " ".join(arguments) in (examples / "README.md").read_text()


@pytest.mark.parametrize("scene", sorted(SCENES))
@pytest.mark.parametrize("seed", range(5))
def test_every_seed_makes_a_scene_of_its_own(scene: str, seed: int) -> None:
    content = SCENES[scene](seed, 30.0)
    assert content != SCENES[scene](seed + 1, 30.0)
    assert parse_trace(content, name=scene).duration_s == pytest.approx(30, abs=1)


def test_an_impossible_length_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["tunnel", "--duration", "0", str(tmp_path / "x.txt")])
    assert caught.value.code == 2
    assert "--duration: 0 is out of range; write 1 to 86400 seconds" in capsys.readouterr().err
