import itertools
from pathlib import Path

from robot_offload.bench import page, pictures
from robot_offload.bench.analysis import commanded, cuts, latency
from robot_offload.bench.groups.commanded import CASE
from robot_offload.bench.plan import QUICK
from robot_offload.bench.results import Outcome, Sample
from robot_offload.bench.store import Kept
from tests.unit.bench.test_commanded import to_the_robot
from tests.unit.bench.test_cuts import account

MACHINE = {"cores": 2, "processor": "CPU X", "memory_gb": 24, "system": "Linux 6", "python": "3.12", "versions": {}}


def outcomes() -> list[Outcome]:
    run, seen = to_the_robot()
    ways: tuple[Sample, ...] = tuple(
        {"way": way, "payload_bytes": 64.0, "latency_ms": value} for way in pictures.WAYS for value in (1.0, 2.0)
    )
    return [
        commanded.outcome(CASE, "realtime", run, seen, []),
        commanded.outcome(CASE, "normal", run, seen, []),
        cuts.outcome(CASE, "realtime", account()),
        Outcome(latency.GROUP, "realtime", (), (), ways),
    ]


def kept() -> list[Kept]:
    return [Kept(outcome, "2026-01-02", MACHINE, (0.5, 0.7), QUICK) for outcome in outcomes()]


def test_the_page_has_a_table_for_each_priority_with_verdicts_and_the_machine(tmp_path: Path):
    text = page.write(kept(), tmp_path).read_text()
    assert "## Figures, real-time priority" in text
    assert "## Figures, normal priority" in text
    assert "| Command gap at a commanded switch, p99 | 5ms each way (tolerance 30 ms) | 1 | **20.0 ms** |" in text
    assert "2 cores (CPU X), 24 GB, Linux 6, Python 3.12" in text
    assert "| Sudden cuts, real-time priority | 2026-01-02 | 0.5 / 0.7 |" in text


def test_every_picture_of_the_page_is_there(tmp_path: Path):
    text = page.write(kept(), tmp_path).read_text()
    for name in ("bench-commanded", "bench-cuts", "bench-latency"):
        assert f"(images/{name}.png)" in text
        assert (tmp_path / "images" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_groups_without_samples_have_no_picture():
    assert pictures.draw([Outcome("resources", "realtime", (), (), ())]) == {}


def test_the_tables_of_markdown_are_whole(tmp_path: Path):
    lines = page.write(kept(), tmp_path).read_text().splitlines()
    for before, line in itertools.pairwise(lines):
        if before.startswith("|") and line.startswith("|"):
            assert before.count("|") == line.count("|"), line
