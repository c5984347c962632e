"""Draws what docs/viewers shows of a recording: `python -m scripts.recording_picture RUN.mcap PICTURE.png`."""

import sys
from pathlib import Path
from typing import Any

from matplotlib import pyplot as plt
from rosbags.highlevel import AnyReader

SITES = {0: "robot", 1: "cloud"}


def read(file: Path) -> dict[str, list[tuple[float, Any]]]:
    """Return (seconds since the beginning, message) of each topic."""
    found: dict[str, list[tuple[float, Any]]] = {}
    with AnyReader([file]) as bag:
        for connection, at_ns, raw in bag.messages():
            message = bag.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append(((at_ns - bag.start_time) / 1e9, message))
    return found


def draw(topics: dict[str, list[tuple[float, Any]]], out: Path) -> None:
    """Draw round trips, who acts, whose messages pass, and the reasons."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(10, 5), sharex=True, height_ratios=(3, 2))
    trips = topics["/offload/round_trip_ms"]
    above.plot([at for at, _ in trips], [message.data for _, message in trips], linewidth=0.8)
    above.set(ylabel="/offload/round_trip_ms", ylim=(0, None))
    end_s = max(at for messages in topics.values() for at, _ in messages)
    for name, shift in (("/offload/acting", 0.0), ("/offload/passing", 0.06)):
        points = [*((at, message.data) for at, message in topics[name]), (end_s, topics[name][-1][1].data)]
        below.step([at for at, _ in points], [value + shift for _, value in points], where="post", label=name)
    before = None
    for at, message in topics["/offload/acting"]:
        if before is not None and message.data != before:
            said = [reason.data for moment, reason in topics["/offload/reason"] if moment <= at + 0.05]
            below.annotate(said[-1], (at, 0.5), rotation=60, fontsize=8)
        before = message.data
    below.set(yticks=list(SITES), yticklabels=list(SITES.values()), xlabel="s", ylim=(-0.2, 1.4))
    below.legend(loc="upper right", fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    draw(read(Path(sys.argv[1])), Path(sys.argv[2]))
