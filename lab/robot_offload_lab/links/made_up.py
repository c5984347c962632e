"""Made-up links of many kinds, to find the figures of the rule on some kinds and to try it on others.

Each family draws its own figures from the seed, so that two seeds are two links of a kind. The figures are invented, to
resemble the link they name. No family was fitted to a recording.

    python -m robot_offload_lab.links.made_up roaming --seed 3 --duration 120 link.csv
"""

from __future__ import annotations

import argparse
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload_lab.links.recorded import CSV_HEADER, Trace

PACE_S: Final = 0.020
"""A request leaves when the answer to the previous one has come, but never sooner than this after it."""
LOST_S: Final = 0.100
"""Time between two requests while nothing comes back."""


class TraceBuilder:
    """Builds a trace, request by request."""

    def __init__(self, name: str, rng: random.Random, duration_s: float) -> None:
        self.name, self.rng, self.duration_s = name, rng, duration_s
        self.now_s = 0.0
        self.times_s: list[float] = []
        self.rtts_ms: list[float | None] = []

    @property
    def running(self) -> bool:
        """Whether there is time left."""
        return self.now_s < self.duration_s

    def answer(self, rtt_ms: float) -> None:
        """Add a request that is answered after `rtt_ms`."""
        rtt_ms = round(max(0.5, rtt_ms), 1)
        self.times_s.append(round(self.now_s, 4))
        self.rtts_ms.append(rtt_ms)
        self.now_s += max(PACE_S, rtt_ms / 1e3)

    def calm(self, length_s: float, base_ms: float, jitter_ms: float) -> None:
        """Add round trips with an exponential tail."""
        until_s = self.now_s + length_s
        while self.now_s < until_s and self.running:
            self.answer(base_ms + self.rng.expovariate(1 / jitter_ms))

    def stall(self, length_s: float) -> None:
        """Add a time in which everything is held, and released at the end."""
        self.answer(length_s * 1e3)

    def cut(self, length_s: float) -> None:
        """Add a time in which everything is lost."""
        until_s = self.now_s + length_s
        while self.now_s < until_s and self.running:
            self.times_s.append(round(self.now_s, 4))
            self.rtts_ms.append(None)
            self.now_s += min(LOST_S, max(PACE_S, until_s - self.now_s))

    def trace(self) -> Trace:
        """Return the trace."""
        return Trace(self.name, tuple(self.times_s), tuple(self.rtts_ms), self.now_s)


def _lognormal(rng: random.Random, median: float, spread: float) -> float:
    return median * math.exp(rng.gauss(0, spread))


def mobile(out: TraceBuilder) -> None:
    """Add 4G: a slow swell, short stalls every few seconds or minutes, sometimes a change of the cell."""
    rng = out.rng
    base_ms, jitter_ms = rng.uniform(30, 65), rng.uniform(4, 14)
    stall_every_s, stall_s = rng.uniform(4, 40), rng.uniform(0.15, 0.4)
    cell_every_s, cell_s = rng.uniform(60, 300), rng.uniform(0.4, 2.0)
    while out.running:
        swell_ms = 10 * math.sin(2 * math.pi * out.now_s / 47)
        out.calm(min(5.0, rng.expovariate(1 / stall_every_s)), base_ms + swell_ms, jitter_ms)
        if rng.random() < 5.0 / stall_every_s:
            out.stall(_lognormal(rng, stall_s, 0.4))
        if rng.random() < 5.0 / cell_every_s:
            out.cut(_lognormal(rng, cell_s, 0.5))


def roaming(out: TraceBuilder) -> None:
    """Add a robot driving through Wi-Fi cells: it gets slower, then nothing comes for a while."""
    rng = out.rng
    base_ms, jitter_ms = rng.uniform(5, 14), rng.uniform(1, 5)
    every_s, outage_s = rng.uniform(8, 45), rng.uniform(0.3, 6.0)
    while out.running:
        out.calm(rng.uniform(0.5, 1.5) * every_s, base_ms, jitter_ms)
        out.calm(rng.uniform(0.2, 3.0), 2 * base_ms, rng.uniform(5, 40))
        (out.stall if rng.random() < 0.5 else out.cut)(_lognormal(rng, outage_s, 0.5))
        for _ in range(rng.randrange(4)):  # the new cell is not found at once
            out.calm(rng.uniform(0.1, 1.0), base_ms, jitter_ms)
            out.stall(rng.uniform(0.1, 0.8))


def periodic(out: TraceBuilder) -> None:
    """Add the same outage again and again, as in the thesis: 4 s every 20 s."""
    rng = out.rng
    every_s, outage_s = rng.choice([(20.0, 4.0), (20.0, 4.0), (10.0, 1.0), (30.0, 6.0), (5.0, 0.5)])
    base_ms = rng.uniform(5, 25)
    while out.running:
        out.calm(every_s - outage_s, base_ms, 2.0)
        out.cut(outage_s)


def repeater(out: TraceBuilder) -> None:
    """Add a Wi-Fi repeater: minutes of calm, minutes of jitter around the limit with bursts of long round trips."""
    rng = out.rng
    base_ms, rough_ms = rng.uniform(15, 40), rng.uniform(20, 70)
    calm_s, rough_s = rng.uniform(20, 200), rng.uniform(20, 200)
    burst = rng.uniform(0.02, 0.3)
    while out.running:
        out.calm(rng.expovariate(1 / calm_s), base_ms, rng.uniform(2, 10))
        until_s = out.now_s + rng.expovariate(1 / rough_s)
        while out.now_s < until_s and out.running:
            out.calm(rng.uniform(0.05, 1.0), base_ms, rough_ms)
            if rng.random() < burst:
                out.calm(rng.uniform(0.1, 0.6), base_ms + 2 * rough_ms, rough_ms)


def fibre(out: TraceBuilder) -> None:
    """Add cable and fibre: uneventful, with a stall every few minutes."""
    rng = out.rng
    base_ms, every_s = rng.uniform(4, 20), rng.uniform(40, 400)
    while out.running:
        out.calm(rng.expovariate(1 / every_s), base_ms, rng.uniform(0.5, 3))
        out.stall(_lognormal(rng, 0.15, 0.6))


def evening(out: TraceBuilder) -> None:
    """Add a line shared with others: queues fill within seconds and empty again, over the limit for a while."""
    rng = out.rng
    base_ms, full_ms = rng.uniform(12, 30), rng.uniform(80, 220)
    idle_s, busy_s, ramp_s = rng.uniform(5, 60), rng.uniform(1, 20), rng.uniform(0.3, 4)
    while out.running:
        out.calm(rng.expovariate(1 / idle_s), base_ms, 4)
        busy_until_s = out.now_s + rng.expovariate(1 / busy_s)
        queue_ms = 0.0
        while out.now_s < busy_until_s and out.running:
            queue_ms = min(full_ms, queue_ms + full_ms * PACE_S / ramp_s * rng.uniform(0, 2))
            if rng.random() < 0.01:
                queue_ms *= rng.uniform(0.1, 0.6)  # another sender backs off
            out.answer(base_ms + queue_ms + rng.expovariate(1 / 6))


def tunnel(out: TraceBuilder) -> None:
    """Add long stretches without any link, with a poor link just before and after each."""
    rng = out.rng
    base_ms, open_s, dark_s = rng.uniform(20, 50), rng.uniform(30, 240), rng.uniform(8, 60)
    while out.running:
        out.calm(rng.uniform(0.5, 1.5) * open_s, base_ms, 6)
        for _ in range(rng.randrange(6)):
            out.calm(rng.uniform(0.2, 2.0), base_ms * 1.5, 25)
            out.cut(rng.uniform(0.1, 1.0))
        out.cut(rng.uniform(0.5, 1.5) * dark_s)
        for _ in range(rng.randrange(6)):
            out.calm(rng.uniform(0.2, 2.0), base_ms * 1.5, 25)
            out.cut(rng.uniform(0.1, 1.0))


def diurnal(out: TraceBuilder) -> None:
    """Add a link whose load swings slowly: stalls are rare at one time and frequent at another."""
    rng = out.rng
    base_ms, day_s = rng.uniform(10, 35), rng.uniform(200, 900)
    rare_s, frequent_s, stall_s = rng.uniform(30, 120), rng.uniform(0.7, 4), rng.uniform(0.1, 0.6)
    while out.running:
        load = 0.5 - 0.5 * math.cos(2 * math.pi * out.now_s / day_s)
        every_s = math.exp((1 - load) * math.log(rare_s) + load * math.log(frequent_s))
        out.calm(min(10.0, rng.expovariate(1 / every_s)), base_ms, 3 + 10 * load)
        out.stall(_lognormal(rng, stall_s, 0.5))


def interference(out: TraceBuilder) -> None:
    """Add Wi-Fi beside other senders: spells in which it stalls several times a second."""
    rng = out.rng
    base_ms = rng.uniform(4, 12)
    quiet_s, loud_s = rng.uniform(1, 40), rng.uniform(0.5, 20)
    between_s, stall_s = rng.uniform(0.05, 0.6), rng.uniform(0.06, 0.35)
    while out.running:
        out.calm(rng.expovariate(1 / quiet_s), base_ms, 2)
        until_s = out.now_s + rng.expovariate(1 / loud_s)
        while out.now_s < until_s and out.running:
            out.calm(rng.expovariate(1 / between_s), base_ms, 4)
            out.stall(_lognormal(rng, stall_s, 0.6))


def satellite(out: TraceBuilder) -> None:
    """Add low orbit: every 15 s a new path with another delay, after a short gap or some slow tenths of a second."""
    rng = out.rng
    gap_s, slow_s, dark = rng.uniform(0.08, 0.4), rng.uniform(0.0, 1.0), rng.uniform(0.0, 0.1)
    while out.running:
        base_ms = rng.uniform(25, 55)
        out.calm(14.5, base_ms, rng.uniform(3, 9))
        out.stall(_lognormal(rng, gap_s, 0.3))
        out.calm(rng.uniform(0, slow_s), base_ms + rng.uniform(30, 120), 10)
        if rng.random() < dark:
            out.cut(rng.uniform(2, 15))


def two_states(out: TraceBuilder) -> None:
    """Add good and bad spells of widely varying length (Gilbert and Elliott's channel with heavy tails)."""
    rng = out.rng
    base_ms = rng.uniform(8, 40)
    good_s, bad_s = (
        math.exp(rng.uniform(math.log(0.5), math.log(40))),
        math.exp(rng.uniform(math.log(0.1), math.log(8))),
    )
    spread, whole = rng.uniform(0.3, 1.5), rng.random()
    while out.running:
        out.calm(_lognormal(rng, good_s, spread), base_ms, 4)
        length_s = min(60.0, _lognormal(rng, bad_s, spread))
        if rng.random() < whole:
            out.stall(length_s)
        else:
            out.calm(length_s, base_ms + 90, 40)


def lossy(out: TraceBuilder) -> None:
    """Add radio at its range: single losses all the time, runs of losses when something is in the way."""
    rng = out.rng
    base_ms, share = rng.uniform(8, 40), rng.uniform(0.002, 0.04)
    shade_every_s, shade_s = rng.uniform(5, 60), rng.uniform(0.3, 5)
    while out.running:
        until_s = out.now_s + rng.expovariate(1 / shade_every_s)
        while out.now_s < until_s and out.running:
            out.calm(rng.expovariate(share / PACE_S), base_ms, 4)
            out.cut(PACE_S)
        until_s = out.now_s + _lognormal(rng, shade_s, 0.7)
        while out.now_s < until_s and out.running:
            out.calm(rng.uniform(0.02, 0.2), base_ms, 25)
            out.cut(rng.uniform(0.02, 0.5))


@dataclass(frozen=True)
class Family:
    """A kind of link.

    Attributes:
        make: builds a link.
        tolerance_s: tolerance that a user of such a link would ask for.
        held_out: whether it is only reported on: no figure of the rule was found on it.
    """

    make: Callable[[TraceBuilder], None]
    tolerance_s: float
    held_out: bool = False


FAMILIES: Final[Mapping[str, Family]] = {
    "mobile": Family(mobile, 0.100),
    "roaming": Family(roaming, 0.020),
    "periodic": Family(periodic, 0.030),
    "fibre": Family(fibre, 0.020),
    "evening": Family(evening, 0.050),
    "diurnal": Family(diurnal, 0.040),
    "two-states": Family(two_states, 0.050),
    "lossy": Family(lossy, 0.050),
    "repeater": Family(repeater, 0.050, held_out=True),
    "tunnel": Family(tunnel, 0.080, held_out=True),
    "interference": Family(interference, 0.020, held_out=True),
    "satellite": Family(satellite, 0.080, held_out=True),
}


def made(family: str, seed: int, duration_s: float) -> Trace:
    """Return a link of the family; the same seed gives the same link."""
    out = TraceBuilder(f"{family}-{seed}", random.Random(f"{family} {seed}"), duration_s)
    FAMILIES[family].make(out)
    return out.trace()


def corridor_wifi(seed: int, duration_s: float) -> str:
    """Return the link of a robot driving through a building on Wi-Fi, in the text format.

    About 11 ms with a long tail; every 15-25 s the robot changes to the next access point: the link stands
    still for 0.15-0.9 s, and for some seconds before that it gets slower.
    """
    rng = random.Random(seed)
    lines = [_origin("corridor-wifi", seed, duration_s, " Round trips in ms, back to back.")]
    elapsed_s = 0.0
    roam_s = rng.uniform(10, 18)
    while elapsed_s < duration_s:
        if elapsed_s >= roam_s:
            rtt_ms = rng.uniform(150, 900)
            roam_s = elapsed_s + rng.uniform(15, 25)
        else:
            fading = max(0.0, 1 - (roam_s - elapsed_s) / 3.0)
            rtt_ms = 9 + rng.expovariate(1 / 3) + 25 * fading * rng.random()
            if rng.random() < 0.004:
                rtt_ms += rng.uniform(20, 70)
        lines.append(f"{rtt_ms:.1f}")
        elapsed_s += round(rtt_ms, 1) / 1000
    return "\n".join(lines) + "\n"


def yard_4g(seed: int, duration_s: float) -> str:
    """Return the link of a robot in a yard on 4G, in the CSV format, ten requests a second.

    40-60 ms in a slow swell with a long tail; 1 % of the requests are lost singly, and about every 40 s a
    change of the cell loses all requests for 0.5-2.5 s.
    """
    rng = random.Random(seed)
    lines = [
        _origin("yard-4g", seed, duration_s, " An empty rtt_ms is a lost request."),
        CSV_HEADER,
    ]
    gap_from_s = rng.uniform(20, 35)
    gap_until_s = gap_from_s + rng.uniform(0.5, 2.5)
    for index in range(int(duration_s * 10)):
        t_s = index / 10
        if t_s >= gap_until_s:
            gap_from_s = t_s + rng.uniform(30, 50)
            gap_until_s = gap_from_s + rng.uniform(0.5, 2.5)
        rtt_ms = 50 + 10 * math.sin(2 * math.pi * t_s / 37) + rng.expovariate(1 / 8)
        if rng.random() < 0.01:
            rtt_ms += rng.uniform(60, 250)
        lost = gap_from_s <= t_s < gap_until_s or rng.random() < 0.01
        lines.append(f"{t_s:.1f}," if lost else f"{t_s:.1f},{rtt_ms:.1f}")
    return "\n".join(lines) + "\n"


def as_csv(trace: Trace, origin: str) -> str:
    """Return the text of a recording, its origin in the first line."""
    lines = [origin, CSV_HEADER]
    for t_s, rtt_ms in zip(trace.times_s, trace.rtts_ms, strict=True):
        lines.append(f"{t_s:g}," if rtt_ms is None else f"{t_s:g},{rtt_ms:g}")
    return "\n".join(lines) + "\n"


def text(kind: str, seed: int, duration_s: float) -> str:
    """Return the text of a link of a family, or of a scene; the same seed gives the same text."""
    if kind in SCENES:
        return SCENES[kind](seed, duration_s)
    return as_csv(made(kind, seed, duration_s), _origin(kind, seed, duration_s))


SCENES: Final[Mapping[str, Callable[[int, float], str]]] = {"corridor-wifi": corridor_wifi, "yard-4g": yard_4g}
"""Links of the examples: one link each, written by hand, in one of the two formats. No figure was found on them."""


def _origin(kind: str, seed: int, duration_s: float, meaning: str = "") -> str:
    return f"# Made up: {kind} --seed {seed} --duration {duration_s:g}.{meaning}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line: `KIND --seed N --duration S FILE`; return 0 when the file is written."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.links.made_up", description="Made-up links.")
    parser.add_argument("kind", choices=sorted((*FAMILIES, *SCENES)))
    parser.add_argument("--seed", type=int, default=1, help="another number is another link of the kind (default 1)")
    parser.add_argument("--duration", type=float, default=60.0, help="seconds (default 60)")
    parser.add_argument("file", type=Path)
    options = parser.parse_args(arguments)
    if not 1 <= options.duration <= 86400:
        parser.error(f"--duration: {options.duration:g} is out of range; write 1 to 86400 seconds")
    try:
        options.file.write_text(text(options.kind, options.seed, options.duration), encoding="utf-8")
    except OSError as error:
        parser.error(f"cannot write {options.file}: {error.strerror}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
