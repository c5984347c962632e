import json
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.bench import results, table
from robot_offload_lab.bench.plan import QUICK
from robot_offload_lab.bench.results import Figure, GroupResult
from robot_offload_lab.bench.store import Kept, Store


def figure(value: float | None, **changes: object) -> Figure:
    given = {"must": 60.0, "aim": 53.0, **changes}
    return Figure("gap_p99", "Gap", "5ms each way", 30, 100, value, "ms", **given)  # type: ignore[arg-type]


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
    assert table.verdict(one) == word


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(None, "ms", "not measured"), (0, "messages", "0"), (1.234, "ms", "1.23 ms"), (51.43, "ms", "51.4 ms"),
     (151.4, "ms", "151 ms"), (8.0, "% of a core", "8.00 % of a core")],
)  # fmt: skip
def test_numbers_have_the_digits_they_deserve(value: float | None, unit: str, text: str):
    assert table.number(value, unit) == text


def test_limits_say_their_direction():
    assert table.limit(figure(1.0), 60.0) == "≤ 60 ms"
    assert table.limit(figure(1.0, at_least=True), 80.0) == "≥ 80 ms"
    assert table.limit(figure(1.0), 0.0) == "0"
    assert table.limit(figure(1.0), None) == ""


def test_a_figure_is_told_in_multiples_of_what_was_measured_beside_it():
    one = figure(50.0, baseline=20.0, against="direct DDS")
    assert one.ratio == pytest.approx(2.5)
    assert (table.ratio(one), table.beside(one)) == ("2.50", "direct DDS: 20.0 ms")
    assert (table.ratio(figure(50.0)), table.beside(figure(50.0))) == ("", "")
    assert figure(50.0, baseline=0.0).ratio is None


def test_a_part_leaves_out_what_was_not_seen():
    part = results.part("x", "ms", [1.0, None, 3.0])
    assert part is not None
    assert (part.count, part.p50, part.highest) == (2, 2.0, 3.0)
    assert results.part("x", "ms", [None]) is None


def kept(group: str, value: float, priority: results.Priority = "realtime") -> Kept:
    parts = results.parts([results.part("gap", "ms", [1.0, 2.0])])
    samples = ({"number": 1, "to": "robot", "gap_ms": 50.5, "phase_ms": None},)
    machine = {
        "cores": 2, "processor": "CPU", "memory_gb": 24, "system": "Linux", "python": "3.12", "versions": {"X": "1"}
    }  # fmt: skip
    return Kept(
        GroupResult(group, priority, (figure(value),), parts, samples), "2026-01-02", machine, (0.5, 1.0), QUICK
    )


def test_what_is_put_into_the_folder_comes_out_again(tmp_path: Path):
    store = Store(tmp_path / "out")
    store.put(kept("commanded", 51.0))
    (found,) = store.all()
    assert found == kept("commanded", 51.0)


def test_a_group_measured_again_replaces_only_itself(tmp_path: Path):
    store = Store(tmp_path)
    store.put(kept("commanded", 51.0))
    store.put(kept("cuts", 180.0))
    store.put(kept("commanded", 55.0))
    store.put(kept("commanded", 58.0, "normal"))
    values = [(one.outcome.group, one.outcome.priority, one.outcome.figures[0].value) for one in store.all()]
    assert values == [("commanded", "realtime", 55.0), ("commanded", "normal", 58.0), ("cuts", "realtime", 180.0)]


def test_the_results_say_what_was_demanded_and_kept(tmp_path: Path):
    Store(tmp_path).put(kept("commanded", 55.0))
    written = json.loads((tmp_path / "results.json").read_text())["groups"]["commanded"]["realtime"]["figures"][0]
    assert (written["must_met"], written["aim_met"]) == (True, False)


def test_an_empty_folder_holds_nothing(tmp_path: Path):
    assert Store(tmp_path).all() == ()


@pytest.mark.parametrize("text", ["{}", "no json", '{"schema": "other"}'])
def test_a_folder_of_something_else_is_refused(tmp_path: Path, text: str):
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(InputError, match="give another --out"):
        Store(tmp_path).all()
