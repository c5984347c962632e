"""Plays the schedule of an emulated link on a robot's wire, as the recorder believes it to be."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Mapping
from typing import Final

from robot_offload_lab.cluster.wire import Cut, Wire
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.schedule import Pair, Schedule

_LOOK_S: Final = 0.25
_CLOSE_S: Final = 0.05
"""How closely conditions are followed that change all the time (a replayed trace); as the recorder samples them."""
_CUTS: Final[Mapping[tuple[bool, bool], Cut | None]] = {
    (True, True): "both",
    (True, False): "to_cloud",
    (False, True): "to_robot",
    (False, False): None,
}


class Weather:
    """A thread that sets the wire whenever the schedule changes."""

    def __init__(self, wire: Wire, schedule: Schedule) -> None:
        self._wire = wire
        self._schedule = schedule
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._set: Pair | None = None
        self._put(schedule.quiet())

    def start(self) -> float:
        """Starts the schedule's clock; returns the moment (steady clock, seconds)."""
        start_s = steady_s()
        self._thread = threading.Thread(target=self._play, args=(start_s,), name="weather", daemon=True)
        self._thread.start()
        return start_s

    def stop(self) -> None:
        """Ends the play; the wire is as it is before a schedule starts. Legal at any time."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._put(self._schedule.quiet())

    def _play(self, start_s: float) -> None:
        while not self._stopped.is_set():
            t_s = steady_s() - start_s
            self._put(self._schedule.at(t_s))
            change_s = self._schedule.next_change_s(t_s)
            wait_s = _CLOSE_S if change_s is None else change_s - (steady_s() - start_s)
            self._stopped.wait(min(max(wait_s, 0.0), _LOOK_S))

    def _put(self, pair: Pair) -> None:
        if pair == self._set:
            return
        self._set = pair
        up, down = pair
        assert dataclasses.replace(up, cut=False) == dataclasses.replace(down, cut=False), (
            "the wire is the same both ways"
        )
        self._wire.set(
            delay_ms=up.delay_ms,
            jitter_ms=up.jitter_ms,
            loss_pct=up.loss * 100.0,
            cut=_CUTS[up.cut, down.cut],
        )
