"""The actions that a person may take on a robot's page, and why not."""

from __future__ import annotations

from typing import Final

from nicegui import background_tasks, ui

from robot_offload.console.actions import Action, Permission, Want, useless
from robot_offload.console.live import Key
from robot_offload.console.session import Session
from robot_offload.errors import RobotOffloadError
from robot_offload.insight.observed import Observed

LASTING: Final = {None: "until let go", 60.0: "1 min", 600.0: "10 min", 3600.0: "1 h"}
SHOWN: Final = (Want.PIN_ROBOT, Want.PIN_CLOUD, Want.AUTO, Want.OBSERVE, Want.SWITCH, Want.TAKE_OVER)
ASK_AGAIN_S: Final = 30.0
"""Rights may change while a page is open."""


class Buttons:
    """The row of buttons."""

    def __init__(self, session: Session, key: Key) -> None:
        self._session = session
        self._key = key
        self._may: dict[Want, Permission] = {}
        self._observed: Observed | None = None
        with ui.row().classes("items-center gap-2"):
            self._for = ui.select(LASTING, value=None, label="Pin lasts").props("dense outlined").classes("w-32")
            self._made = {want: self._button(want) for want in SHOWN}
        self._reason = ui.label().classes("text-grey").classes("mark-forbidden")
        ui.timer(ASK_AGAIN_S, self._ask)

    def _button(self, want: Want) -> tuple[ui.button, ui.tooltip]:
        colour = "negative" if want is Want.TAKE_OVER else "primary"
        button = ui.button(want.value, on_click=lambda: self._act(want)).props(f"dense no-caps color={colour}")
        button.classes(f"mark-{want.name}")
        button.disable()
        with button:
            tip = ui.tooltip("asking whether you may")
        return button, tip

    def show(self, observed: Observed | None) -> None:
        """Update the buttons for the resource as it is now."""
        self._observed = observed
        reasons = set()
        for want, (button, tip) in self._made.items():
            may = self._may.get(want, Permission(False, "asking whether you may"))
            no = may.reason if not may.allowed else useless(Action(want, self._for.value), observed)
            if not may.allowed:
                reasons.add(may.reason)
            if tip.text != no:
                tip.text = no
                tip.set_visibility(bool(no))
            if button.enabled is bool(no):
                button.set_enabled(not no)
        text = "; ".join(sorted(reasons))
        if self._reason.text != text:
            self._reason.text = text

    async def _ask(self) -> None:
        source = self._session.source
        for want in SHOWN:
            try:
                self._may[want] = await source.may(self._key, Action(want))
            except RobotOffloadError as error:
                self._may[want] = Permission(False, str(error))
        self.show(self._observed)

    def _act(self, want: Want) -> None:
        background_tasks.create(self._do(Action(want, self._for.value)), name=f"console: {want.name}")

    async def _do(self, action: Action) -> None:
        try:
            said, colour = await self._session.source.act(self._key, action), "positive"
        except RobotOffloadError as error:
            said, colour = str(error), "negative"
        with self._reason:
            ui.notify(said, type=colour, multi_line=True)  # type: ignore[arg-type]  # one of the accepted words
