"""The page of one robot: which side acts and why, live and scrolled back."""

from __future__ import annotations

import datetime
from typing import Any, Final

from nicegui import run, ui

from robot_offload.console import figures, frame, tables
from robot_offload.console.buttons import Buttons
from robot_offload.console.live import NOTHING, UNKNOWN, Key, Live
from robot_offload.console.model import SILENT_S, Track
from robot_offload.console.other_rules import replay
from robot_offload.console.rows import PLACES
from robot_offload.console.session import Session
from robot_offload.errors import InputError
from robot_offload.insight.staying import Stay, staying

UPDATE_S: Final = 0.1
"""A change is on the screen within this time; without one nothing is sent."""
TABLES_S: Final = 0.5
"""Tables of numbers are read, not watched."""
STEP_S: Final = 10.0
"""How far an arrow key scrolls."""


class Shown:
    """A table that is sent to the browser only when it changes."""

    def __init__(self, title: str, labels: dict[str, str], empty: str) -> None:
        with ui.card().classes(f"w-full p-3 gap-1 mark-{title.partition(' ')[0]}").props("flat bordered"):
            ui.label(title).classes("text-subtitle1 text-weight-medium").props('role=heading aria-level="2"')
            columns = [{"name": name, "label": label, "field": name, "align": "left"} for name, label in labels.items()]
            self._table = ui.table(columns=columns, rows=[], row_key=next(iter(labels)), pagination=0)
            self._table.classes("w-full console-wrap").props("flat dense wrap-cells hide-bottom")
            self._table.set_visibility(False)
            self._empty = ui.label(empty).classes("text-grey")

    def show(self, rows: list[dict[str, Any]]) -> None:
        """Show these rows."""
        if self._table.rows != rows:
            self._table.rows = rows
            self._table.set_visibility(bool(rows))
            self._empty.set_visibility(not rows)


class RobotPage:
    """One tab with one robot."""

    def __init__(self, session: Session, key: Key) -> None:
        self._session = session
        self._key = key
        self._version = -1
        self._tables_s = 0.0
        self._back_s = 0.0  # how far it is scrolled back
        frame.build(session, key.name)
        self._banner = frame.Banner()
        self._head()
        self._buttons = Buttons(session, key)
        self._chart = ui.echart({"series": []}).classes("w-full").style("height: 290px").classes("mark-strips")
        self._scroll()
        self._why = self._card("Why is it not switching back?")
        self._others()
        self._build_tables()
        watching = session.source.watching(key)
        watching.__enter__()
        ui.context.client.on_delete(lambda: watching.__exit__(None, None, None))
        self.update()
        ui.timer(UPDATE_S, self.update)

    def _head(self) -> None:
        with ui.row().classes("items-center w-full gap-4"):
            ui.link("← all robots", "/")
            ui.label(str(self._key)).classes("text-h5").props('role=heading aria-level="1"')
            self._place = ui.badge().classes("text-subtitle1").classes("mark-placement")
            self._line = ui.label().classes("text-body1").classes("mark-line")
        self._reason = ui.label().classes("text-body1").classes("mark-reason")

    def _scroll(self) -> None:
        with ui.row().classes("items-center w-full no-wrap"):
            ui.label("Past").classes("text-grey")
            self._slider = ui.slider(min=-1, max=0, value=0, step=0.5, on_change=lambda event: self._go(event.value))
            self._slider.props('aria-label="scroll back, seconds"').classes("mark-past")
            self._when = ui.label("live").style("min-width: 9em").classes("mark-when")
            ui.button("Live", on_click=lambda: self._slider.set_value(0)).props("dense flat")
        ui.keyboard(on_key=self._on_key)

    def _on_key(self, event: Any) -> None:
        steps = {"ArrowLeft": -STEP_S, "ArrowRight": STEP_S, "l": figures.WINDOW_S * 1e3}
        if event.action.keydown and str(event.key) in steps:
            oldest = float(self._slider.props["min"])
            self._slider.set_value(min(0.0, max(oldest, self._slider.value + steps[str(event.key)])))

    def _go(self, value: float) -> None:
        self._back_s = -float(value)
        self._version = -1

    @staticmethod
    def _card(title: str) -> ui.column:
        with ui.card().classes("w-full p-3 gap-1").props("flat bordered"):
            ui.label(title).classes("text-subtitle1 text-weight-medium").props('role=heading aria-level="2"')
            return ui.column().classes("gap-0 w-full").classes("mark-why")

    def _others(self) -> None:
        with ui.card().classes("w-full p-3 gap-1").props("flat bordered"):
            ui.label("What would another rule have done?").classes("text-subtitle1 text-weight-medium")
            labels = {
                "rule": "Rule", "cloud": "In the cloud", "changes": "Changes",
                "exposed": "In the cloud over a bad link", "cost": "Cost",
            }  # fmt: skip
            columns = [{"name": name, "label": text, "field": name, "align": "left"} for name, text in labels.items()]
            table = ui.table(columns=columns, rows=[], row_key="rule", pagination=0).classes("w-full console-wrap")
            table.props("flat dense hide-bottom")
            table.set_visibility(False)
            said = ui.label().classes("text-grey").classes("mark-others")

            async def judge() -> None:
                track = self._track()
                points = list(track.points)
                try:
                    table.rows = await run.io_bound(replay(), points, _switching(track)) or []
                except InputError as error:
                    said.text = str(error)
                    return
                table.set_visibility(True)
                said.text = (
                    f"Of the link of the last {points[-1].t_s - points[0].t_s:.0f} s, as it was seen here. Cost: a "
                    "second in the cloud over a bad link 10, a second on the robot over a good one 1, a change 0.5."
                )

            ui.button("Replay the last minutes", on_click=judge).props("dense outline")

    def _build_tables(self) -> None:
        self._nodes = Shown(
            "Nodes",
            {"node": "Node", "placement": "Runs", "robot": "On the robot", "cloud": "In the cloud",
             "standby": "Standby", "core": "", "pod": "Pod"},
            "no node is known",
        )  # fmt: skip
        self._topics = Shown(
            "Topics",
            {"topic": "Topic", "rate": "Rate", "bandwidth": "Bandwidth", "age": "Age", "carried": "Carried",
             "messages": "Messages", "leftOut": "Thinned, refused"},
            "nothing has crossed the link yet",
        )  # fmt: skip
        self._handed = Shown(
            "Goals, calls, state", {"what": "What", "state": "State", "detail": "Figures"}, "none is known"
        )
        self._changes = Shown(
            "Changeovers", {"when": "When", "to": "To", "reason": "Why", "gap": "Silence"}, "none since this page knows"
        )
        self._conditions = Shown(
            "Conditions", {"type": "Condition", "status": "Status", "why": "Why", "since": "Since"}, "no resource"
        )
        self._endpoints = Shown("Endpoints", {"purpose": "For", "address": "Address"}, "none is known")
        self._certificates = Shown(
            "Certificates", {"owner": "Of", "serial": "Serial", "ends": "Ends", "left": "Left"}, "none is known"
        )
        self._events = Shown("Events", {"event": "Event"}, "none")
        self._numbers = Shown("The robot's own numbers", {"name": "Figure", "value": "Value"}, "it has sent none")

    def _track(self) -> Track:
        return self._session.fleet.tracks.get(self._key) or Track(self._key)

    def update(self) -> None:
        """Show what has changed."""
        session, track = self._session, self._track()
        now_s = session.now_s()
        missing = "" if self._key in session.fleet.tracks else f"there is no RobotOffload {self._key}"
        old = track.heard_s is not None and not session.fleet.recorded and now_s - track.heard_s > SILENT_S
        silent = f"the newest live numbers are {now_s - (track.heard_s or 0):.0f} s old" if old else ""
        self._banner.show(
            "; ".join(filter(None, (session.fleet.problem, missing or track.problem or silent, track.live.note)))
        )
        if self._version == track.version and not old:
            return
        self._version = track.version
        self._extend(track)
        end_s = (track.heard_s or now_s) - self._back_s
        live = track.live if self._back_s == 0 else track.at(end_s)
        self._when.text = "live" if self._back_s == 0 else tables.when(end_s, run=session.fleet.recorded)
        self._show_head(track, live)
        self._chart.options.update(figures.strips(track, end_s, run=session.fleet.recorded))
        self._chart.update()
        if now_s - self._tables_s >= TABLES_S or session.fleet.recorded:
            self._tables_s = now_s
            self._show_tables(track, live, end_s)

    def _extend(self, track: Track) -> None:
        if track.points:
            oldest = min(-1.0, track.points[0].t_s - track.points[-1].t_s)
            if abs(float(self._slider.props["min"]) - oldest) > 1.0:
                self._slider.props["min"] = round(oldest, 1)
                self._slider.update()

    def _show_head(self, track: Track, live: Live) -> None:
        observed = track.observed
        site = live.site if live is not NOTHING else (observed.placement.lower() if observed else UNKNOWN)
        self._place.text = PLACES.get(site, "? Unknown")
        self._place.props(f"color={ {'robot': 'deep-orange-9', 'cloud': 'blue-9'}.get(site, 'grey-8') }")
        reason = (live.reason, live.message)
        if live is NOTHING and observed:
            reason = (observed.placement_reason, observed.placement_message)
        self._reason.text = ": ".join(part for part in reason if part)
        self._line.text = line(live)
        self._buttons.show(observed)

    def _show_tables(self, track: Track, live: Live, end_s: float) -> None:
        now = datetime.datetime.now(datetime.UTC)
        sentences = list(staying(stay(track, live), track.observed))
        if getattr(self, "_sentences", None) != sentences:
            self._sentences = sentences
            self._why.clear()
            with self._why:
                for sentence in sentences:
                    ui.label(sentence)
        self._nodes.show(tables.nodes(track, live))
        self._topics.show(tables.topics(track, live, end_s))
        self._handed.show(tables.handed(live))
        self._changes.show(tables.changeovers(track, run=self._session.fleet.recorded))
        self._conditions.show(tables.conditions(track, now))
        self._endpoints.show(tables.endpoints(track))
        self._certificates.show(tables.certificates(track, now))
        self._events.show([{"event": event} for event in track.events])
        self._numbers.show([{"name": name, "value": value} for name, value in live.numbers])


def line(live: Live) -> str:
    """Return the link as one line."""
    if live is NOTHING:
        return ""
    parts = [f"changeover {live.epoch}"] if live.epoch else []
    if live.cut:
        parts.append("the link is cut")
    elif live.latency_ms is not None:
        parts.append(f"loop latency {live.latency_ms:.0f} ms")
    if live.loss_share is not None:
        parts.append(f"loss {live.loss_share:.1%}")
    return ", ".join(parts)


def stay(track: Track, live: Live) -> Stay:
    """Return what `insight` needs to explain why the cloud does not act."""
    known, observed = live is not NOTHING, track.observed
    return Stay(
        site=live.site if known else (observed.placement.lower() if observed else UNKNOWN),
        reason=live.reason if known else (observed.placement_reason if observed else ""),
        message=live.message if known else (observed.placement_message if observed else ""),
        connected=live.connected if known else bool(observed and observed.connected),
        latency_ms=None if live.cut else live.latency_ms,
        allowed_ms=track.bounds.allowed_ms if known else None,
        loss_timeout_ms=track.bounds.loss_timeout_ms,
        hold_down_s=track.bounds.hold_down_s,
    )


def _switching(track: Track) -> dict[str, Any]:
    return dict((track.manifest.get("spec") or {}).get("switching") or {})
