"""What the relay holds outlives it: whole records in their order, and nothing that is not whole."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload_agent.relay.journal import FILE_NAME, Journal

SMALL = 1 << 14
RECORDS = st.lists(st.binary(min_size=1, max_size=200), max_size=20)


@given(first=RECORDS, compacted=st.none() | RECORDS, second=RECORDS)
def test_the_successor_finds_all_records_in_their_order(
    tmp_path_factory: pytest.TempPathFactory, first: list[bytes], compacted: list[bytes] | None, second: list[bytes]
) -> None:
    folder = tmp_path_factory.mktemp("run")
    journal = Journal(folder, SMALL)
    assert all(journal.append(record) for record in first)
    expected = first
    if compacted is not None:
        assert journal.compact(compacted)
        expected = compacted
    successor = Journal(folder, SMALL)
    assert successor.load() == expected
    assert all(successor.append(record) for record in second)
    assert Journal(folder, SMALL).load() == [*expected, *second]


def test_a_record_without_room_is_refused_and_the_others_stay(tmp_path: Path) -> None:
    journal = Journal(tmp_path, SMALL)
    record = bytes(1000)
    count = 0
    while journal.append(record):
        count += 1
    assert count == 8  # of 1000 bytes, in half of 16 KiB
    assert not journal.compact([record] * 9)
    assert Journal(tmp_path, SMALL).load() == [record] * 8
    assert journal.compact([record])
    assert journal.append(b"more")
    assert Journal(tmp_path, SMALL).load() == [record, b"more"]


def test_records_of_an_earlier_use_of_a_half_are_not_found_again(tmp_path: Path) -> None:
    journal = Journal(tmp_path, SMALL)
    for _ in range(4):
        assert journal.append(b"old" * 30)
    for number in range(5):
        assert journal.compact([b"%d" % number])
    assert Journal(tmp_path, SMALL).load() == [b"4"]


@settings(max_examples=60, deadline=None)
@given(garbage=st.binary(max_size=600), at=st.integers(0, SMALL - 1))
def test_a_file_with_anything_else_in_it_ends_nothing(
    tmp_path_factory: pytest.TempPathFactory, garbage: bytes, at: int
) -> None:
    folder = tmp_path_factory.mktemp("run")
    journal = Journal(folder, SMALL)
    records = [b"%d" % n * 50 for n in range(20)]
    assert all(journal.append(record) for record in records)
    with (folder / FILE_NAME).open("r+b") as file:
        file.seek(at)
        file.write(garbage[: SMALL - at])
    found = Journal(folder, SMALL).load()
    assert found == records[: len(found)]


WRITER = """
import os, pathlib, sys
from robot_offload_agent.relay.journal import Journal
journal, number = Journal(pathlib.Path(sys.argv[1]), 1 << 20), 0
while True:
    number += 1
    record = b"%d." % number * 300
    if journal.append(record) or journal.compact([record]):
        os.write(1, number.to_bytes(4, "big"))
"""
"""A process of its own: the tests' one may have threads, and a copy of it would go on after a failure."""


def test_a_relay_killed_while_it_writes_loses_no_record_that_was_kept(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        said = child.stdout.read(4 * 3000)
        child.kill()
        said += child.stdout.read()
    kept = int.from_bytes(said[-4:], "big")
    numbers = [int(record.partition(b".")[0]) for record in Journal(tmp_path, 1 << 20).load()]
    assert numbers[-1] in (kept, kept + 1)
    assert numbers == list(range(numbers[0], numbers[-1] + 1))


def test_on_a_full_disk_the_relay_starts_and_remembers_until_it_ends(tmp_path: Path) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", str(tmp_path)], check=True)
    try:
        journal = Journal(tmp_path, SMALL)
        assert not journal.kept
        assert journal.append(b"a goal")
        assert journal.load() == [b"a goal"]
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
