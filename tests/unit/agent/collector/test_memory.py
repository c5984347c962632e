"""What a collector remembers over its own death: who passed, and nothing that is not whole."""

import subprocess
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.runtime.collector_memory import MEMORY_BYTES, NOBODY, HolderView, Memory
from robot_offload_core.collector import gate
from robot_offload_core.collector.state import Collector
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.holding import Holding

INCARNATIONS = st.text("0123456789abcdef", min_size=32, max_size=32)


def state(charge: Charge | None, started_us: int = 0, fell_back: bool = False, stay: int = 0) -> Collector:
    empty = gate.start((), 0.15, 0.25)
    return gate.resume(empty, charge, started_us, fell_back, 0.0, stay) if charge else empty


@given(
    site=st.sampled_from(Site), robot=INCARNATIONS, epoch=st.integers(1, 2**63), cloud=INCARNATIONS | st.just(""),
    started_us=st.integers(0, 2**63), fell_back=st.booleans(), stay=st.integers(0, 2**63),
)  # fmt: skip
def test_the_next_collector_finds_what_the_dead_one_had_reached(
    tmp_path_factory: pytest.TempPathFactory, site: Site, robot: str, epoch: int, cloud: str, started_us: int,
    fell_back: bool, stay: int,
) -> None:  # fmt: skip
    folder = tmp_path_factory.mktemp("run")
    charge = Charge(site, Token(robot, epoch, cloud))
    Memory(folder).save(state(charge, started_us, fell_back, stay))
    assert Memory(folder).load() == (charge, started_us, fell_back, stay)


def test_a_new_memory_and_one_without_a_charge_hold_nothing(tmp_path: Path) -> None:
    memory = Memory(tmp_path)
    assert memory.load() is None
    memory.save(state(None))
    assert memory.load() is None


@given(st.binary(max_size=2 * MEMORY_BYTES))
def test_a_file_with_anything_else_in_it_holds_nothing(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    folder = tmp_path_factory.mktemp("run")
    (folder / "collector.memory").write_bytes(content)
    assert Memory(folder).load() is None


def test_on_a_full_disk_the_collector_starts_and_remembers_until_it_ends(tmp_path: Path) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", str(tmp_path)], check=True)
    try:
        (tmp_path / "much").write_bytes(bytes(4096))
        charge = Charge(Site.ROBOT, Token("ab" * 16, 1, ""))
        memory = Memory(tmp_path)
        memory.save(state(charge))
        assert memory.load() == (charge, 0, False, 0)
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


def test_words_that_are_no_memory_hold_nothing(tmp_path: Path) -> None:
    sites = (b"moon a 1 b 2 0 3", b"robot a x b 2 0 3")
    for text in (*sites, b"robot a 1 b y 0 3", b"robot a 1 b 2 0 y", b"robot a 1 b 2 0", b""):
        (tmp_path / "collector.memory").write_bytes(b"%08x %s" % (zlib.crc32(text), text))
        assert Memory(tmp_path).load() is None


def test_another_process_reads_who_holds(tmp_path: Path) -> None:
    view = HolderView(tmp_path)
    assert view.look() == NOBODY
    memory = Memory(tmp_path)
    assert view.look() == NOBODY
    token = Token("ab" * 16, 7, "cd" * 16)
    memory.save(state(Charge(Site.CLOUD, token), stay=3))
    assert view.look() == Holding(Site.CLOUD, 3, token)
    memory.save(state(Charge(Site.CLOUD, token), fell_back=True, stay=4))
    assert view.look() == Holding(Site.ROBOT, 4, token)


def test_while_the_memory_is_torn_what_was_read_last_holds(tmp_path: Path) -> None:
    view, memory, charge = HolderView(tmp_path), Memory(tmp_path), Charge(Site.CLOUD, Token("ab" * 16, 7, ""))
    memory.save(state(charge, stay=3))
    known = view.look()
    memory.save(state(Charge(Site.ROBOT, Token("ab" * 16, 8, "")), stay=4))
    whole = memory.map[:]
    for end in range(20, len(whole.rstrip(b"\0"))):
        memory.map[:] = whole[:end].ljust(MEMORY_BYTES, b"7")
        assert view.look() == known
    memory.map[:] = whole
    assert view.look().stay == 4
