"""The newest beat of the partner, from the pulse process to the data process without waking it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload_agent.runtime.heard_memory import FILE_NAME, MEMORY_BYTES, HeardMemory, HeardView
from robot_offload_core.words.messages import Heard

BEAT = Heard("ab" * 16, 123_456_789, 12.5)


def test_a_beat_is_read_once_and_the_next_one_replaces_it(tmp_path: Path) -> None:
    memory, view = HeardMemory(tmp_path), HeardView(tmp_path)
    assert view.news() is None
    memory.write(BEAT)
    assert view.news() == BEAT
    assert view.news() is None
    newer = Heard("cd" * 16, 123_476_789, 12.52)
    memory.write(BEAT)
    memory.write(newer)
    assert view.news() == newer


def test_nothing_is_there_before_the_pulse_process_has_started(tmp_path: Path) -> None:
    view = HeardView(tmp_path)
    assert view.news() is None
    (tmp_path / FILE_NAME).touch()
    assert view.news() is None
    HeardMemory(tmp_path).write(BEAT)
    assert view.news() == BEAT


def test_a_reader_that_starts_anew_gets_the_newest_and_so_does_one_of_a_new_writer(tmp_path: Path) -> None:
    HeardMemory(tmp_path).write(BEAT)
    view = HeardView(tmp_path)
    assert view.news() == BEAT
    newer = Heard(BEAT.incarnation, 5, 13.0)
    HeardMemory(tmp_path).write(newer)
    assert view.news() == newer


@pytest.mark.parametrize("garbage", [bytes(MEMORY_BYTES), b"\xff" * MEMORY_BYTES, bytes(range(MEMORY_BYTES))])
def test_what_is_not_whole_is_no_beat(tmp_path: Path, garbage: bytes) -> None:
    memory, view = HeardMemory(tmp_path), HeardView(tmp_path)
    memory.write(BEAT)
    assert view.news() == BEAT
    (tmp_path / FILE_NAME).write_bytes(garbage)
    assert view.news() is None
