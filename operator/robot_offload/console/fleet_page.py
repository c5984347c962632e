"""The page of all robots: one sortable line each."""

from __future__ import annotations

import datetime
from typing import Any, Final

from nicegui import ui

from robot_offload.console import frame
from robot_offload.console.live import Key
from robot_offload.console.model import Track
from robot_offload.console.rows import SPARK_HEIGHT, SPARK_WIDTH, row
from robot_offload.console.session import Session

UPDATE_S: Final = 0.2
"""Five updates a second: in a table, the eye does not follow more."""
NAME_CELL: Final = """
<q-td :props="props"><a :href="props.row.link" class="console-link">{{ props.value }}</a></q-td>
"""
SPARK_CELL: Final = f"""
<q-td :props="props">
  <svg width="{SPARK_WIDTH}" height="{SPARK_HEIGHT}" role="img" :aria-label="'link: ' + props.row.quality">
    <line x1="0" x2="{SPARK_WIDTH}" :y1="props.row.sparkBound" :y2="props.row.sparkBound" class="console-bound"/>
    <path :d="props.row.sparkCuts" class="console-cut"/>
    <polyline :points="props.row.sparkLine" class="console-line"/>
  </svg>
  <span class="console-quality" :title="props.row.trouble">{{{{ props.row.quality }}}}</span>
</q-td>
"""
_WIDE: Final = {"classes": "console-wide", "headerClasses": "console-wide"}
"""Columns hidden on a page as narrow as a phone's."""


def _column(name: str, label: str, by: str = "", **more: Any) -> dict[str, Any]:
    """Return a column that shows the field `name` and is sorted by the field `by`."""
    return {"name": name, "label": label, "field": by or name, "sortable": True, "align": "left", **more}


COLUMNS: Final = [
    _column("name", "Robot", required=True),
    _column("namespace", "Namespace", **_WIDE),
    _column("placement", "Placement"),
    _column("reason", "Why", classes="console-words"),
    _column("link", "Link, last two minutes", "latency"),
    _column("gap", "Silence of the last switch", "silence", **_WIDE),
    _column("ready", "Ready"),
    _column("generation", "Generation", **_WIDE),
    _column("since", "Since", "sinceSeconds", **_WIDE),
]


class FleetPage:
    """One tab with the fleet."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shown: list[dict[str, Any]] = []
        self._kept: dict[Key, tuple[int, int, dict[str, Any]]] = {}
        frame.build(session, "Fleet")
        with ui.row().classes("items-center w-full"):
            self._filter = ui.input(label="Filter", placeholder="name, side, reason").props("dense clearable autofocus")
            self._count = ui.label().classes("text-grey").classes("mark-count")
        # Not ui.table: it keeps its order on the server, so the second of two quick clicks on a column is lost.
        table = ui.element("q-table").classes("w-full console-fleet")
        table.props('flat dense hide-pagination row-key=id no-data-label="no RobotOffload yet"')
        table.props.update({"columns": COLUMNS, "rows": [], "rows-per-page-options": [0]})
        self._filter.on_value_change(lambda changed: table.props.update(filter=changed.value))
        table.add_slot("body-cell-name", NAME_CELL)
        table.add_slot("body-cell-link", SPARK_CELL)
        table.add_slot("body-cell-gap", '<q-td :props="props">{{ props.row.gap }}</q-td>')
        table.add_slot("body-cell-since", '<q-td :props="props">{{ props.row.since }}</q-td>')
        self._table = table
        self._banner = frame.Banner()
        self.update()
        ui.timer(UPDATE_S, self.update)

    def _row(self, track: Track, now_s: float, now: datetime.datetime) -> dict[str, Any]:
        """Return one robot's line, renewed at each report and each second."""
        kept = self._kept.get(track.key)
        if kept is None or kept[:2] != (track.version, int(now_s)):
            kept = self._kept[track.key] = (track.version, int(now_s), row(track, now_s, now))
        return kept[2]

    def update(self) -> None:
        """Show what has changed."""
        fleet = self._session.fleet
        self._banner.show(fleet.problem)
        now_s, now = self._session.now_s(), datetime.datetime.now(datetime.UTC)
        rows = [self._row(track, now_s, now) for track in fleet.sorted()]
        if rows != self._shown:
            self._shown = rows
            self._table.props["rows"] = rows
            in_cloud = sum(each["placement"].endswith("Cloud") for each in rows)
            self._count.text = f"{len(rows)} {'robot' if len(rows) == 1 else 'robots'}, {in_cloud} in the cloud"
