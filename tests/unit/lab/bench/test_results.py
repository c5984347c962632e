from dataclasses import replace
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.bench import results, rows, table
from robot_offload_lab.bench.results import Figure, GroupResult
from robot_offload_lab.bench.rows import Circumstances, Row

UNDER = Circumstances("short", "2026-01-02", "abc1234", "2 cores", "0.5 before, 1.0 after")


def figure(value: float | None, **changes: object) -> Figure:
    given = {"must": 60.0, "aim": 53.0, **changes}
    return Figure("gap_p99", "Gap", "5ms each way", 30, 100, value, "ms", **given)  # type: ignore[arg-type]


def measured(
    group: str, value: float, priority: results.Priority = "realtime", under: Circumstances = UNDER
) -> list[Row]:
    parts = results.parts([results.part("gap", "ms", [1.0, 2.0])])
    return rows.rows(GroupResult(group, priority, (figure(value),), parts, ()), under)


def row(**changes: object) -> Row:
    (found,) = rows.rows(GroupResult("commanded", "realtime", (figure(51.0, **changes),), (), ()), UNDER)
    return found


@pytest.mark.parametrize(
    ("one", "word"),
    [
        (figure(50.0), "aim"), (figure(53.0), "aim"), (figure(59.0), "must"), (figure(61.0), "missed"),
        (figure(None), ""), (figure(5.0, must=None, aim=None), ""), (figure(50.0, aim=None), "must"),
        (figure(82.0, must=80.0, aim=None, at_least=True), "must"),
        (figure(79.0, must=80.0, aim=None, at_least=True), "missed"),
    ],
)  # fmt: skip
def test_the_verdict_is_the_best_limit_that_was_kept(one: Figure, word: str):
    assert one.kept == word


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [("", "ms", "not measured"), ("0", "messages", "0"), ("1.234", "ms", "1.23 ms"), ("51.43", "ms", "51.4 ms"),
     ("151.4", "ms", "151 ms"), ("8", "% of a core", "8.00 % of a core")],
)  # fmt: skip
def test_numbers_have_the_digits_they_deserve(value: str, unit: str, text: str):
    assert table.number(value, unit) == text


def test_limits_say_their_direction():
    assert table.limit(row(), "must") == "≤ 60 ms"
    assert table.limit(row(must=80.0, at_least=True), "must") == "≥ 80 ms"
    assert table.limit(row(must=0), "must") == "0"
    assert table.limit(row(must=None), "must") == ""


def test_what_was_measured_beside_a_figure_is_named():
    assert table.beside(row(baseline=20.0, against="direct DDS")) == "direct DDS: 20.0 ms"
    assert table.beside(row()) == ""
    assert figure(50.0, baseline=20.0).ratio == 2.5
    assert figure(50.0, baseline=0.0).ratio is None


def test_a_part_leaves_out_what_was_not_seen():
    part = results.part("x", "ms", [1.0, None, 3.0])
    assert part is not None
    assert (part.count, part.p50, part.highest) == (2, 2.0, 3.0)
    assert results.part("x", "ms", [None]) is None


def test_what_is_written_is_read_as_it_was(tmp_path: Path):
    path = tmp_path / "out" / rows.FILE
    rows.write(path, measured("commanded", 51.0))
    found = rows.read(path)
    assert [one["name"] for one in found] == ["gap_p99", ""]
    assert found[0]["conditions"] == "5ms each way (tolerance 30 ms)"
    assert (found[0]["value"], found[0]["kept"], found[1]["p50"]) == ("51", "aim", "1.5")
    rows.write(path, found)
    assert rows.read(path) == found


def test_a_group_measured_again_replaces_only_itself():
    found = [*measured("commanded", 51.0), *measured("cuts", 180.0)]
    found = rows.merged(found, measured("commanded", 55.0))
    found = rows.merged(found, measured("commanded", 58.0, "normal"))
    found = rows.merged(found, measured("commanded", 59.0, under=replace(UNDER, form="long")))
    values = [(one["group"], one["priority"], one["form"], one["value"]) for one in rows.figures(found)]
    assert values == [
        ("cuts", "realtime", "short", "180"), ("commanded", "realtime", "short", "55"),
        ("commanded", "normal", "short", "58"), ("commanded", "realtime", "long", "59"),
    ]  # fmt: skip


def test_a_folder_without_figures_has_none(tmp_path: Path):
    assert rows.read(tmp_path / rows.FILE) == []


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "\x00"])
def test_a_file_of_something_else_is_refused(tmp_path: Path, text: str):
    (tmp_path / rows.FILE).write_text(text)
    with pytest.raises(InputError, match="name another folder"):
        rows.read(tmp_path / rows.FILE)


def test_the_page_prefers_the_long_form_and_real_time_priority():
    short, normal = measured("commanded", 51.0), measured("commanded", 58.0, "normal")
    assert "**51.0 ms**" in table.page([*normal, *short])
    text = table.page([*short, *measured("commanded", 49.0, under=replace(UNDER, form="long"))])
    assert "**49.0 ms**" in text
    assert "**51.0 ms**" not in text


def test_the_page_keeps_what_stands_around_the_table():
    text = f"# Before\n{table.BEGIN}old\n{table.END}after\n"
    again = table.with_table(table.with_table(text, measured("commanded", 51.0)), measured("commanded", 52.0))
    assert again.startswith(f"# Before\n{table.BEGIN}")
    assert again.endswith(f"{table.END}after\n")
    assert "**52.0 ms**" in again
    assert "51.0 ms" not in again


def test_every_line_of_the_table_has_as_many_columns():
    lines = [line for line in table.page(measured("commanded", 51.0)).splitlines() if line]
    assert len({line.count("|") for line in lines}) == 1


def test_every_group_of_the_page_has_a_title():
    assert set(table.HEADLINES) == set(table.TITLES)
