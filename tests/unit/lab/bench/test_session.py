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
from robot_offload_lab.bench import session
from robot_offload_lab.bench.plan import QUICK, Order
from robot_offload_lab.bench.results import Figure, GroupResult
from robot_offload_lab.bench.session import BenchSession, Group, Work
from robot_offload_lab.bench.store import Store


def measured(group: str):
    def run(order: Order) -> GroupResult:
        order.advance(1)
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
    return BenchSession(Console(file=io.StringIO(), width=200), Store(tmp_path))


def run(bench: BenchSession, groups: list[Group], *, resume: bool = False) -> list[str]:
    order = Order(QUICK, "realtime", bench.store.folder, 1, None, lambda _: None)
    return bench.run(groups, ["realtime"], order, resume=resume)


def use(monkeypatch: pytest.MonkeyPatch, works: dict[Group, object]) -> None:
    monkeypatch.setattr(session, "WORK", {group: Work(run, lambda _: 1) for group, run in works.items()})


@pytest.mark.parametrize("error", [RobotOffloadError("the cloud was not seen"), ZeroDivisionError("division by zero")])
def test_a_group_that_fails_is_told_and_the_others_are_kept(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch, error: Exception
):
    use(monkeypatch, {Group.CUTS: failing(error), Group.LIFECYCLE: measured("lifecycle")})
    [line] = run(bench, [Group.CUTS, Group.LIFECYCLE])
    assert line.startswith("Sudden cuts, real-time priority: ")
    assert str(error) in line
    assert [one.outcome.group for one in bench.store.all()] == ["lifecycle"]


def test_a_group_that_does_not_end_is_ended_and_the_others_run(bench: BenchSession, monkeypatch: pytest.MonkeyPatch):
    use(monkeypatch, {Group.CUTS: slow, Group.LIFECYCLE: measured("lifecycle")})
    monkeypatch.setattr(session, "LIMITS_S", {"short": 1})
    [line] = run(bench, [Group.CUTS, Group.LIFECYCLE])
    assert "not ended within 1 s" in line
    assert [one.outcome.group for one in bench.store.all()] == ["lifecycle"]


def test_a_group_that_is_asked_for_more_than_its_form_has_may_take_as_much_longer(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch
):
    def lasting(order: Order) -> GroupResult:
        time.sleep(1.2)
        return measured("cuts")(order)

    monkeypatch.setattr(session, "WORK", {Group.CUTS: Work(lasting, lambda amounts: amounts.cuts)})
    monkeypatch.setattr(session, "LIMITS_S", {"short": 1})
    more = Order(replace(QUICK, cuts=100 * QUICK.cuts), "realtime", bench.store.folder, 1, None, lambda _: None)
    assert bench.run([Group.CUTS], ["realtime"], more, resume=False) == []


def test_a_run_that_goes_on_leaves_out_what_was_measured_today_in_the_same_form(
    bench: BenchSession, monkeypatch: pytest.MonkeyPatch
):
    use(monkeypatch, {Group.CUTS: measured("cuts")})
    run(bench, [Group.CUTS])
    use(monkeypatch, {Group.CUTS: failing(AssertionError("measured again")), Group.LIFECYCLE: measured("lifecycle")})
    assert run(bench, [Group.CUTS, Group.LIFECYCLE], resume=True) == []
    assert [one.outcome.group for one in bench.store.all()] == ["cuts", "lifecycle"]
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
    (bench.store.folder / "results.json").write_text('{"schema": "other"}')
    with pytest.raises(InputError, match="give another --out"):
        run(bench, [Group.CUTS])


def test_every_group_has_work_a_title_and_a_place_on_the_page():
    from robot_offload_lab.bench import page
    from robot_offload_lab.bench.table import TITLES

    on_the_page = [group for _, _, groups in page.CHAPTERS for group in groups]
    assert set(session.WORK) == set(Group) == set(TITLES) == set(on_the_page)


def test_every_group_counts_its_steps_from_the_amounts():
    assert all(work.steps(QUICK) > 0 for work in session.WORK.values())


def test_the_pictures_are_drawn_into_the_folder(bench: BenchSession, monkeypatch: pytest.MonkeyPatch):
    def run_lifecycle(order: Order) -> GroupResult:
        samples = tuple({"series": "alone", "ms": value} for value in (1.0, 2.0))
        return GroupResult("lifecycle", order.priority, (), (), samples)

    use(monkeypatch, {Group.LIFECYCLE: run_lifecycle})
    run(bench, [Group.LIFECYCLE])
    bench.show()
    assert (bench.store.folder / "bench-lifecycle-spread.png").read_bytes().startswith(b"\x89PNG")
