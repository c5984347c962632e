import os
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.bench.analysis import resources
from robot_offload_lab.bench.analysis.resources import Usage, Weighed
from robot_offload_lab.bench.groups.resources import CASE, SINGLE, checked_out, usages

SMAPS = """\
7f0000000000-7f0000001000 r-xp 00000000 08:01 42 /usr/lib/libone.so
Rss:                 100 kB
Pss:                  50 kB
Anonymous:             0 kB
7f0000002000-7f0000003000 rw-p 00001000 08:01 42 /usr/lib/libone.so
Rss:                  20 kB
Anonymous:            16 kB
7f0000004000-7f0000005000 rw-p 00000000 00:00 0 [heap]
Rss:                 400 kB
Anonymous:           400 kB
"""
ROLLUP = "5500-7fff ---p 00000000 00:00 0 [rollup]\nRss: 520 kB\nPss: 470 kB\nPss_Anon: 416 kB\n"
STAT = "7 (ro-robot (x) y) S 1 1 1 0 -1 0 0 0 0 0 150 50 0 0 20 0 1 0 100 0 0"


def test_a_process_is_read_from_its_files():
    usage = resources.usage("ro-robot-data\n", STAT, ROLLUP, SMAPS, ticks_per_s=100)
    assert usage.name == "ro-robot-data"
    assert usage.cpu_s == 2.0
    assert usage.pss_bytes == 470 * 1024
    assert usage.file_bytes == {
        "/usr/lib/libone.so@00000000": 100 * 1024, "/usr/lib/libone.so@00001000": 4 * 1024,
    }  # fmt: skip


def test_a_file_that_two_processes_hold_counts_once_when_they_are_alone():
    one = Usage("a", 0.0, 0, 2_000_000, {"x": 5_000_000, "y": 1_000_000})
    two = Usage("b", 0.0, 0, 3_000_000, {"x": 4_000_000})
    assert resources.alone_mb([one, two]) == pytest.approx(11.0)


def weighed(case, *cpu_percent):
    """Both agents with processes that cost as much."""
    costs = tuple(
        resources.Cost(name, cpu, 20.0) for name, cpu in zip(("supervisor", "data"), cpu_percent, strict=False)
    )
    return Weighed(case, 60.0, costs, costs[:1], 55.0)


def test_cost_is_the_difference_over_the_time():
    before = Usage("ro-robot-collec", 10.0, 30_000_000, 0, {})
    after = Usage("ro-robot-collec", 13.0, 40_000_000, 0, {})
    (found,) = resources.costs([before], [after], 60.0)
    assert (found.name, found.cpu_percent, found.pss_mb) == ("collector", pytest.approx(5.0), pytest.approx(40.0))


def test_the_agents_cost_is_shared_out_among_messages_and_topics():
    outcome = resources.outcome("realtime", weighed(CASE, 0.0, 8.0), weighed(SINGLE, 0.0, 6.0))
    figures = {figure.name: figure for figure in outcome.figures}
    assert figures["cpu_robot"].value == pytest.approx(8.0)
    assert figures["cpu_robot"].met(figures["cpu_robot"].aim)
    assert figures["pss_robot"].value == pytest.approx(40.0)
    assert figures["cpu_message"].value == pytest.approx(0.08 / 80 * 1e6)
    assert figures["cpu_topic"].value == pytest.approx(1.0)
    assert "500 µs a message; 5.0 % without any" in figures["cpu_topic"].note
    assert "3 topics to the cloud and the command at 20 Hz" in figures["cpu_robot"].conditions


def test_another_commit_stands_beside():
    whole = weighed(CASE, 0.0, 8.0)
    outcome = resources.outcome("realtime", whole, weighed(SINGLE, 0.0, 6.0), weighed(CASE, 0.0, 16.0), "abc")
    cpu = outcome.figures[0]
    assert (cpu.against, cpu.ratio) == ("abc", pytest.approx(0.5))


def test_a_commit_that_is_not_there_is_refused_with_the_option():
    with pytest.raises(InputError, match=r"--against.*no-such-commit"), checked_out("no-such-commit"):
        pass


def test_this_process_can_be_read_for_real():
    (usage,) = usages([os.getpid()])
    assert usage.cpu_s > 0
    assert 0 < usage.anonymous_bytes < usage.pss_bytes
    assert any(Path(name.rpartition("@")[0]).exists() for name in usage.file_bytes)
