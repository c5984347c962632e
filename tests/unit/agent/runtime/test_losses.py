"""No message of an output vanishes without a word: what was given up is counted, what is too large is a problem."""

from collections import Counter
from pathlib import Path

from robot_offload_agent.runtime import losses
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.parcels import LARGEST_BYTES, TOTAL_BYTES
from robot_offload_core.fence import envelope
from robot_offload_core.fence.token import Token
from robot_offload_core.words.messages import ENVELOPE

HEADER = envelope.encode(envelope.Envelope(Token("ab" * 16, 3, "cd" * 16), 7, 8))


class Process:
    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self.problems: dict[str, tuple[str, str] | None] = {}

    def note(self, key: str, problem: tuple[str, str] | None) -> None:
        self.problems[key] = problem


def test_losses_are_counted_and_reported_by_topic(tmp_path: Path) -> None:
    bus, reader, process = Bus(tmp_path, "data"), Bus(tmp_path, "collector"), Process()
    losses.report(bus, process)
    assert (process.counters, process.problems) == ({}, {})
    for _ in range(TOTAL_BYTES // LARGEST_BYTES + 2):
        bus.carry("collector", ENVELOPE, 0, HEADER, bytes(LARGEST_BYTES), "/map")
    bus.carry("collector", ENVELOPE, 0, HEADER, bytes(LARGEST_BYTES + 1), "/cloud")
    losses.report(bus, process)
    assert process.counters == {"/map.given_up": 2}
    reason, message = process.problems["large /cloud"] or ("", "")
    assert reason == "MessageTooLarge"
    assert "/cloud has 16.8 MB" in message
    for end in (bus, reader):
        end.close()
