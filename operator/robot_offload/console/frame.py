"""Shared by both pages: the head line, the colours, and the line that names a problem."""

from __future__ import annotations

from typing import Final

from nicegui import app, ui

from robot_offload.console.session import Session

STYLE: Final = """
.console-line { fill: none; stroke: #009e73; stroke-width: 1.5; }
.console-bound { stroke: currentColor; stroke-dasharray: 3 3; opacity: 0.5; }
.console-cut { stroke: #d55e00; stroke-width: 2; }
.console-link { color: inherit; font-weight: 600; text-decoration: underline; }
.console-link:focus-visible { outline: 3px solid #0072b2; }
.console-quality { margin-left: 0.5em; font-variant-numeric: tabular-nums; }
.console-words { white-space: normal; min-width: 12em; max-width: 34em; }
.console-wrap td { white-space: normal; overflow-wrap: anywhere; }
@media (max-width: 700px) { .console-wide { display: none; } .console-words { min-width: 8em; } }
"""


class Banner:
    """A line above the page, shown only while there is a problem."""

    def __init__(self) -> None:
        self._row = ui.row().classes("w-full p-2 rounded bg-amber-3 text-black items-center").props("role=alert")
        with self._row:
            ui.icon("warning")
            self._label = ui.label().classes("mark-banner")
        self._row.set_visibility(False)
        self._row.move(target_index=0)

    def show(self, problem: str) -> None:
        """Show the problem, or nothing."""
        if self._label.text != problem:
            self._label.text = problem
            self._row.set_visibility(bool(problem))


def build(session: Session, title: str) -> None:
    """Begin a page."""
    ui.page_title(f"{title} · Robot Offload")
    ui.add_css(STYLE)
    dark = ui.dark_mode(session.dark)

    def toggle() -> None:
        session.dark = not session.dark
        dark.value = session.dark

    with ui.header().classes("items-center no-wrap py-1 px-4 bg-blue-10"):
        ui.link("Robot Offload", "/").classes("text-white text-h6 no-underline whitespace-nowrap")
        ui.label(session.fleet.source).classes("text-white ellipsis").style("max-width: 40vw")
        ui.space()
        ui.button(icon="contrast", on_click=toggle).props('flat round color=white aria-label="dark or light"')
    ui.keyboard(on_key=lambda event: toggle() if event.action.keydown and event.key == "d" else None)


def serve_nothing_else() -> None:
    """Answer an unknown address with our own page, which leads back."""

    @app.exception_handler(404)
    async def missing(*_: object) -> object:
        from fastapi.responses import PlainTextResponse  # noqa: PLC0415

        return PlainTextResponse("404: no such page; the fleet is at /\n", 404)
