import dataclasses
import itertools
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.bench import page, pictures
from robot_offload_lab.bench.analysis import commanded, cuts, latency
from robot_offload_lab.bench.groups.commanded import CASE
from robot_offload_lab.bench.plan import FULL, QUICK, Amounts
from robot_offload_lab.bench.results import GroupResult, Sample
from robot_offload_lab.bench.store import Kept
from tests.unit.lab.bench.test_commanded import to_the_robot
from tests.unit.lab.bench.test_cuts import account

MACHINE = {"cores": 2, "processor": "CPU X", "memory_gb": 24, "system": "Linux 6", "python": "3.12", "versions": {}}


def outcomes() -> list[GroupResult]:
    run, seen = to_the_robot()
    ways: tuple[Sample, ...] = tuple(
        {"way": way, "payload_bytes": 64.0, "latency_ms": value} for way in pictures.WAYS for value in (1.0, 2.0)
    )
    return [
        commanded.outcome(CASE, "realtime", run, seen, []),
        commanded.outcome(CASE, "normal", run, seen, []),
        cuts.outcome(CASE, "realtime", account()),
        GroupResult(latency.GROUP, "realtime", (), (), ways),
    ]


def kept(amounts: Amounts = FULL, date: str = "2026-01-02") -> list[Kept]:
    return [Kept(outcome, date, MACHINE, (0.5, 0.7), amounts) for outcome in outcomes()]


def test_the_page_has_a_section_for_each_group_and_priority_with_date_load_verdicts_and_the_machine(tmp_path: Path):
    text = page.write(kept(), tmp_path).read_text()
    assert "## Switching (`bench switch`)" in text
    assert "### Commanded switches" in text
    assert "Long form, real-time priority, 2026-01-02, machine A; load 0.5 before, 0.7 after:" in text
    assert "Long form, normal priority, 2026-01-02" in text
    assert "| Command gap at a commanded switch, p99 | 5ms each way (tolerance 30 ms) | 1 | **20.0 ms** |" in text
    assert "- machine A: 2 cores (CPU X), 24 GB, Linux 6, Python 3.12" in text


def test_every_picture_of_the_page_is_there(tmp_path: Path):
    text = page.write(kept(), tmp_path).read_text()
    for name in ("bench-commanded", "bench-cuts", "bench-latency", "bench-commanded-spread"):
        assert f"(images/{name}.png)" in text
        assert (tmp_path / "images" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_what_was_measured_at_length_stays_beside_a_later_short_run_with_its_own_date(tmp_path: Path):
    page.write(kept(FULL, "2026-01-02"), tmp_path)
    long_picture = (tmp_path / "images" / "bench-cuts.png").read_bytes()
    text = page.write(kept(QUICK, "2026-02-03"), tmp_path).read_text()
    assert "Long form, real-time priority, 2026-01-02" in text
    assert "Short form, real-time priority, 2026-02-03" in text
    assert "(images/bench-cuts.png)" in text
    assert "(images/bench-cuts-short.png)" in text
    assert (tmp_path / "images" / "bench-cuts.png").read_bytes() == long_picture


def test_a_group_measured_again_in_the_same_form_takes_the_place_of_the_earlier_one(tmp_path: Path):
    page.write(kept(QUICK, "2026-01-02"), tmp_path)
    text = page.write(kept(QUICK, "2026-02-03")[:1], tmp_path).read_text()
    dates = [line for line in text.splitlines() if line.startswith("Short form")]
    assert len(dates) == 4
    assert sum("2026-02-03" in line for line in dates) == 1


def test_what_the_page_was_made_of_comes_back_as_it_was(tmp_path: Path):
    page.write(kept(), tmp_path)
    first = page.read(tmp_path)
    again = page.merged((), first)
    assert again == first
    assert first[0].figures == tuple(_rounded(figure) for figure in outcomes()[0].figures)


def _rounded(figure):
    return dataclasses.replace(figure, value=None if figure.value is None else round(figure.value, 4))


@pytest.mark.parametrize("text", ["{}", "no json", '{"schema": "other", "sections": []}'])
def test_a_damaged_source_of_the_page_is_refused_before_it_is_overwritten(tmp_path: Path, text: str):
    (tmp_path / page.SOURCE).write_text(text)
    with pytest.raises(InputError, match="restore it"):
        page.write(kept(), tmp_path)
    assert (tmp_path / page.SOURCE).read_text() == text


def test_the_pictures_tell_date_load_and_machine_of_each_measurement_once():
    found = page.notes(kept())
    assert found["commanded"] == "2026-01-02, load 0.5 / 0.7, 2 cores (CPU X), 24 GB, Linux 6, Python 3.12, "
    two = page.notes([*kept(FULL, "2026-01-02")[:1], *kept(FULL, "2026-02-03")[1:2]])
    assert len(two["commanded"].splitlines()) == 2


def test_groups_without_samples_have_no_picture():
    assert pictures.draw([GroupResult("resources", "realtime", (), (), ())]) == {}


def test_the_tables_of_markdown_are_whole(tmp_path: Path):
    lines = page.write(kept(), tmp_path).read_text().splitlines()
    for before, line in itertools.pairwise(lines):
        if before.startswith("|") and line.startswith("|"):
            assert before.count("|") == line.count("|"), line
