"""What a person sees while a run goes on: a live picture on a terminal, or one line per event.

A view never fails: when its reader is gone (a closed terminal, the end of a pipe) it falls silent.
"""

from __future__ import annotations

import os
from contextlib import suppress
from typing import Final, Protocol

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from robot_offload_lab.show.watch import LiveRun, SwitchSeen

SITE_COLOURS: Final = {"robot": "dark_orange", "cloud": "dodger_blue2"}
_LINK_COLOURS: Final = {"good": "green", "slow": "yellow", "cut": "red"}
_LINK_SIGNS: Final = {"good": "●", "slow": "◐", "cut": "○"}
REFRESH_S: Final = 0.1
_SWITCHES_SHOWN: Final = 8
_CORRIDOR: Final = 60
"""Characters from the beginning of the corridor to its end."""
_FULL_SPEED_MPS: Final = 1.2
_SPEED_CELLS: Final = 12


class Terminal(Console):
    """A console that falls silent at the end of its pipe instead of ending the program."""

    def on_broken_pipe(self) -> None:
        """Discard all further output, including what Python has buffered for the pipe."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


class View(Protocol):
    """Shows a run."""

    def say(self, text: str) -> None:
        """Show a step of the preparation or of the end."""

    def show(self, watch: LiveRun, now_s: float) -> None:
        """Show the present state; called several times a second."""

    def close(self) -> None:
        """End the picture; later lines are printed below it."""


class LineView:
    """One line per event, for logs, pipes and people who prefer less output."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, text: str) -> None:
        """Print the line."""
        with suppress(OSError):
            self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def show(self, watch: LiveRun, now_s: float) -> None:
        """Print what has happened since the last call."""
        del now_s
        for event in watch.events():
            when = "   start" if watch.start_s is None else f"{watch.since_start(event.t_s):6.2f} s"
            self.say(f"{when}  {event.text}")

    def close(self) -> None:
        """Do nothing: nothing is open."""


class LiveView:
    """A picture that is redrawn ten times a second."""

    def __init__(self, console: Console, title: str) -> None:
        """Prepare.

        Args:
            console: a terminal.
            title: stands above the picture.
        """
        self._console = console
        self._title = title
        self._live: Live | None = None
        self._shown_s = 0.0

    def say(self, text: str) -> None:
        """Print the line above the picture, or below it once that is closed."""
        with suppress(OSError):
            self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def show(self, watch: LiveRun, now_s: float) -> None:
        """Draw the picture, if it is time."""
        watch.events()
        if watch.start_s is None or now_s < self._shown_s + REFRESH_S:
            return
        self._shown_s = now_s
        with suppress(OSError):
            if self._live is None:
                self._live = Live(console=self._console, auto_refresh=False)
                self._live.start()
            self._live.update(picture(watch, now_s, self._title), refresh=True)

    def close(self) -> None:
        """Leave the last picture where it is."""
        if self._live is not None:
            with suppress(OSError):
                self._live.stop()
            self._live = None


def picture(watch: LiveRun, now_s: float, title: str) -> RenderableType:
    """Return the whole picture."""
    rows = Table.grid(padding=(0, 2))
    rows.add_column(style="dim", min_width=9)
    rows.add_column()
    rows.add_row("time", Text(f"{watch.since_start(now_s):.1f} s"))
    if watch.link is not None:
        rows.add_row("link", _link(watch))
    rows.add_row("placement", _placement(watch, now_s))
    if watch.drive:
        rows.add_row("corridor", _corridor(watch))
        rows.add_row("speed", _speed(watch))
    for goal in watch.goals.values():
        rows.add_row("goal", Text(f"{goal.ending or 'on the way'}, {goal.feedback} feedback, turns: {goal.servers}"))
    for topic, received in watch.received.items():
        rows.add_row("output", Text(f"{topic}: {received} messages"))
    return Panel(Group(rows, Text(), _switches(watch)), title=title, title_align="left", border_style="dim")


def _link(watch: LiveRun) -> Text:
    word = watch.link_word()
    text = Text(f"{_LINK_SIGNS[word]} {word}", style=_LINK_COLOURS[word])
    assert watch.link is not None
    if watch.link.rtt_ms is not None:
        text.append(f"  {watch.link.rtt_ms:.0f} ms there and back", style="default")
        text.append(f", limit {watch.threshold_ms:.0f} ms", style="dim")
    return text


def _placement(watch: LiveRun, now_s: float) -> Text:
    change = watch.placement
    if change is None:
        return Text("not announced yet", style="dim")
    text = Text(f"{change.site:5}", style=f"bold {SITE_COLOURS[change.site]}")
    text.append(f"  for {now_s - watch.charged_s:.1f} s  ", style="default")
    return text.append(f"{change.reason}: {change.message}", style="dim")


def _corridor(watch: LiveRun) -> Text:
    drive = watch.drive
    position = min(_CORRIDOR - 1, max(0, round(drive["x_m"] / drive["length_m"] * _CORRIDOR)))
    goal = min(_CORRIDOR - 1, round(drive["goal_x_m"] / drive["length_m"] * _CORRIDOR))
    cells = ["━" if cell <= position else "─" for cell in range(_CORRIDOR)]
    cells[goal] = "⚑"
    cells[position] = "●"
    site = watch.placement.site if watch.placement else "robot"
    text = Text("".join(cells[: position + 1]), style=SITE_COLOURS[site])
    text.append("".join(cells[position + 1 :]), style="dim")
    return text.append(f"  {drive['x_m']:.1f} of {drive['length_m']:.0f} m", style="default")


def _speed(watch: LiveRun) -> Text:
    speed_mps = abs(watch.drive["speed_mps"])
    full = min(_SPEED_CELLS, round(speed_mps / _FULL_SPEED_MPS * _SPEED_CELLS))
    text = Text("▮" * full + "▯" * (_SPEED_CELLS - full) + f"  {speed_mps:.2f} m/s")
    if watch.drive["inhibited"]:
        text.append("  inhibited", style="red")
    collisions, stops = watch.drive["collisions"], watch.drive["stops"]
    return text.append(f"  collisions {collisions}, forced stops {stops}", style="red" if collisions else "dim")


def _switches(watch: LiveRun) -> RenderableType:
    if not watch.switches:
        return Text("no switch so far", style="dim")
    table = Table(box=None, padding=(0, 2), header_style="dim")
    for name, justify in (("switch", "right"), ("to", "left"), ("reason", "left"), ("noticed", "right")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]  # one of the words it knows
    table.add_column("silence", justify="right")
    hidden = len(watch.switches) - _SWITCHES_SHOWN
    for switch in watch.switches[-_SWITCHES_SHOWN:]:
        table.add_row(*_switch_cells(watch, switch))
    return Group(Text(f"{hidden} earlier switches", style="dim"), table) if hidden > 0 else table


def _switch_cells(watch: LiveRun, switch: SwitchSeen) -> tuple[RenderableType, ...]:
    noticed = "commanded" if switch.detect_ms is None else f"{switch.detect_ms:.0f} ms"
    gap = "…" if switch.gap_ms is None else f"{switch.gap_ms:.0f} ms"
    return (
        f"{watch.since_start(switch.t_s):.1f} s",
        Text(switch.to, style=SITE_COLOURS[switch.to]),
        switch.reason,
        noticed,
        gap,
    )
