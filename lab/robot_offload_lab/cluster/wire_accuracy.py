"""Measures the delay that a wire itself adds: round trips over one, without any cluster (needs root).

`python -m robot_offload_lab.cluster.wire_accuracy`.

Both ends run with real-time priority, so that delays of a busy machine do not count as the wire's.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence

from robot_offload_lab.cluster import netns, network, ownership, processes, programs
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import Layout
from robot_offload_lab.cluster.preflight import preflight
from robot_offload_lab.cluster.robot_host import Neighbour

PORT = 7000
PRIORITY = 30  # above the wire's own
COUNT, PERIOD_MS = 1000, 10
DELAYS_MS = (0.0, 10.0)


def main() -> int:
    """Measure, print a table."""
    if why := preflight():
        sys.stderr.write(f"{why}\n")
        return 1
    tester = programs.ensure(_say, programs.PODS, programs.POD_MODULE).path("tester")
    layout, lock = ownership.claim(None, None)
    try:
        network.build(layout)
        # The other end is the router: one wire in between and nothing else.
        realtime = ["chrt", "--fifo", str(PRIORITY), str(tester)]
        log = layout.home / "server.log"
        server = processes.spawn(
            [*netns.into(layout.netns("net")), *realtime, "serve", str(PORT)], log, die_with_us=True
        )
        _say("| delay each way | real time | answers | p50 | p99 | longest |\n|---|---|---|---|---|---|")
        for fast in (True, False):
            host = Neighbour(layout, f"host-{fast}".lower(), 1, die_with_us=True, gone=lambda _: None)
            host.build(realtime=fast)
            for delay in DELAYS_MS:
                host.wire.set(delay_ms=delay)
                _say(_row(delay, fast, _measured(host, layout, realtime)))
            host.remove()
        server.kill()
    finally:
        ownership.remove(layout)
        lock.close()
    _say(
        f"{COUNT} round trips of UDP, one every {PERIOD_MS} ms; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )
    return 0


def _measured(host: Neighbour, layout: Layout, realtime: Sequence[str]) -> dict[str, int]:
    words = [*realtime, "measure", f"{layout.router}:{PORT}", str(COUNT), str(PERIOD_MS)]
    deadline = time.monotonic() + 20
    while True:
        try:
            found: dict[str, int] = json.loads(host.run(*words))
        except ClusterError:  # the other end does not listen yet
            found = {"answers": 0}
        if found["answers"] or time.monotonic() > deadline:
            return found
        time.sleep(0.1)


def _row(delay: float, fast: bool, found: dict[str, int]) -> str:
    spoken = [f"{found[key] / 1000:.2f} ms" for key in ("p50", "p99", "max")]
    cells = [f"{delay:.0f} ms", "yes" if fast else "no", str(found["answers"]), *spoken]
    return f"| {' | '.join(cells)} |"


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
