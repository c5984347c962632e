import os
from pathlib import Path

import pytest

from robot_offload_lab.bench.analysis import resources
from robot_offload_lab.bench.analysis.resources import Usage
from robot_offload_lab.bench.groups.resources import CASE, usages

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


def test_cost_is_the_difference_over_the_time():
    before = Usage("a", 10.0, 30_000_000, 0, {})
    after = Usage("a", 13.0, 40_000_000, 0, {})
    found = resources.outcome(CASE, "realtime", [before], [after], 60.0)
    cpu, pss = found.figures
    assert cpu.value == pytest.approx(5.0)
    assert pss.value == pytest.approx(40.0)
    assert cpu.met(cpu.aim)
    assert "3 topics to the cloud and the command at 20 Hz" in cpu.conditions


def test_this_process_can_be_read_for_real():
    (usage,) = usages([os.getpid()])
    assert usage.cpu_s > 0
    assert 0 < usage.anonymous_bytes < usage.pss_bytes
    assert any(Path(name.rpartition("@")[0]).exists() for name in usage.file_bytes)
