import io
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from robot_offload.errors import InputError, RobotOffloadError
from robot_offload_lab.bench import rows, session, table
from robot_offload_lab.bench.plan import QUICK, Order, changed
from robot_offload_lab.bench.results import Figure, GroupResult
from robot_offload_lab.bench.rows import FILE
from robot_offload_lab.bench.session import PAGE, BenchSession, Group


def measured(group: str):
    def run(order: Order) -> GroupResult:
        return GroupResult(group, order.priority, (Figure("x", "X", "none", None, 1, 1.0, "ms"),), (), ())

    return run


def failing(error: Exception):
    def run(_order: Order) -> GroupResult:
        raise error

    return run


def slow(_order: Order) -> GroupResult:
    time.sleep(30)
    raise AssertionError


@pytest.fixture
def bench(tmp_path: Path) -> BenchSession:
    return BenchSession(Console(file=io.StringIO(), width=200), tmp_path)


def run(bench: BenchSession, groups: list[Group], *, resume: bool = False) -> list[str]:
    order = Order(QUICK, "realtime", bench.folder, 1, None)
    return bench.run(groups, ["realtime"], order, resume=resume)


def use(monkeypatch: pytest.MonkeyPatch, works: dict[Group, object]) -> None:
    monkeypatch.setattr(session, "WORK", works)


@pytest.mark.parametrize("error", [RobotOffloadError("the cloud was not seen"), ZeroDivisionError("division by zero")])
def test_a_group_that_fails_is_told_and_the_others_are_kept(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch, error: Exception
):
    use(monkeypatch, {Group.CUTS: failing(error), Group.LIFECYCLE: measured("lifecycle")})
    [line] = run(bench, [Group.CUTS, Group.LIFECYCLE])
    assert line.startswith("Sudden cuts, real-time priority: ")
    assert str(error) in line
    assert [one["group"] for one in bench.known()] == ["lifecycle"]


def test_a_group_that_does_not_end_is_ended_and_the_others_run(bench: BenchSession, monkeypatch: pytest.MonkeyPatch):
    use(monkeypatch, {Group.CUTS: slow, Group.LIFECYCLE: measured("lifecycle")})
    monkeypatch.setattr(session, "LIMITS_S", {"short": 1})
    [line] = run(bench, [Group.CUTS, Group.LIFECYCLE])
    assert "not ended within 1 s" in line
    assert [one["group"] for one in bench.known()] == ["lifecycle"]


def test_a_group_with_amounts_of_its_own_is_measured_again_although_the_run_goes_on(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch
):
    use(monkeypatch, {Group.CUTS: measured("cuts")})
    more = Order(changed(QUICK, ["cuts=100"]), "realtime", bench.folder, 1, None)
    assert bench.run([Group.CUTS], ["realtime"], more, resume=False) == []
    use(monkeypatch, {Group.CUTS: failing(RobotOffloadError("measured again"))})
    assert len(bench.run([Group.CUTS], ["realtime"], more, resume=True)) == 1


def test_a_run_that_goes_on_leaves_out_what_was_measured_today_in_the_same_form(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch
):
    use(monkeypatch, {Group.CUTS: measured("cuts")})
    run(bench, [Group.CUTS])
    use(monkeypatch, {Group.CUTS: failing(AssertionError("measured again")), Group.LIFECYCLE: measured("lifecycle")})
    assert run(bench, [Group.CUTS, Group.LIFECYCLE], resume=True) == []
    assert [one["group"] for one in bench.known()] == ["cuts", "lifecycle"]
    assert len(run(bench, [Group.CUTS])) == 1  # without --resume it is measured again


def test_the_bench_itself_is_punctual_while_it_measures_and_what_it_starts_is_a_normal_process(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch
):
    seen = []

    def look(order: Order) -> GroupResult:
        question = "import os; print(os.sched_getscheduler(0))"
        started = subprocess.run([sys.executable, "-c", question], capture_output=True, text=True, check=True)
        seen.append((os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, int(started.stdout)))
        return measured("cuts")(order)

    use(monkeypatch, {Group.CUTS: look})
    run(bench, [Group.CUTS])
    permitted = os.SCHED_FIFO if os.geteuid() == 0 else os.SCHED_OTHER
    assert seen == [(permitted, os.SCHED_OTHER)]
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_a_folder_of_something_else_is_refused_before_anything_runs(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch
):
    use(monkeypatch, {Group.CUTS: failing(AssertionError("ran"))})
    (bench.folder / FILE).write_text("a,b\n")
    with pytest.raises(InputError, match="name another folder"):
        run(bench, [Group.CUTS])


def test_every_group_has_work_a_title_and_a_place_on_the_page():
    assert set(session.WORK) == set(Group) == set(table.TITLES) == set(table.HEADLINES)


def test_what_was_measured_is_published_beside_what_was_there(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    docs = tmp_path / "docs"
    use(monkeypatch, {Group.CUTS: measured("cuts"), Group.LIFECYCLE: measured("lifecycle")})
    for group in (Group.CUTS, Group.LIFECYCLE):
        one = replace(bench, folder=tmp_path / group.value, docs=docs)
        assert run(one, [group]) == []
        one.show()
    assert [row["group"] for row in rows.read(docs / FILE)] == ["cuts", "lifecycle"]
    assert (docs / PAGE).read_text().startswith("# Benchmarks\n")


def test_a_damaged_file_of_the_docs_is_refused_before_anything_runs(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    use(monkeypatch, {Group.CUTS: failing(AssertionError("ran"))})
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / FILE).write_text("a,b\n")
    with pytest.raises(InputError, match="restore the file"):
        run(replace(bench, docs=docs), [Group.CUTS])
    assert (docs / FILE).read_text() == "a,b\n"
