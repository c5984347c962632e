"""The files by which the cloud's agent and the operator communicate: settings and handover in, the state out."""

from __future__ import annotations

import datetime
import json
import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings.files import NewestWriter, Watch, age_s
from robot_offload_agent.settings.liaison import LEAVING_S, AnswerRead, Event, HandoverAsked, SettingsRead
from robot_offload_agent.settings.notes import MAX_ANSWER
from robot_offload_agent.settings.offer import read_offer
from robot_offload_agent.settings.parameters import Configuration

log = logging.getLogger(__name__)

HANDOVER = re.compile(r"[A-Za-z0-9._:-]{1,128}")
RENEW_S = 0.16
"""The state is written again after this, even if nothing has changed: people watch its figures live, and its age shows
that the agent lives. With the control process's ticks of 20 ms and more these are five to six writes a second."""


def wall_text() -> str:
    """Return the system clock, RFC 3339 in UTC."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class ClusterFiles:
    """Watches three files and writes one; those without a name are off."""

    def __init__(self, configuration: Configuration, happened: Callable[[Event], None]) -> None:
        """`happened` is called on threads of this class."""
        self.happened = happened
        self.settings_file: str = configuration["settings_file"]
        self.handover_file: str = configuration["handover_file"]
        self.certificate_file: str = configuration["certificate_file"]
        self.state_file: str = configuration["state_file"]
        self.writer = NewestWriter(Path(self.state_file)) if self.state_file else None
        self.written: dict[str, Any] = {}
        self.written_s = float("-inf")

    def start(self) -> None:
        """Begin to watch."""
        if self.settings_file:
            Watch(Path(self.settings_file), self._settings).start()
        if self.handover_file:
            Watch(Path(self.handover_file), self._handover).start()
        if self.certificate_file:
            Watch(Path(self.certificate_file), self._answer).start()

    def tell(self, state: dict[str, Any], now: float, figures: Callable[[], dict[str, Any]]) -> None:
        """Write the state if it has changed, or if the last writing is a while ago.

        `figures` differ each time: they are included in the next writing but do not cause one.
        """
        if self.writer is None or (state == self.written and now - self.written_s < RENEW_S):
            return
        self.written, self.written_s = state, now
        self.writer.write(json.dumps({"written": wall_text(), **state, **figures()}))

    def _settings(self, text: str | None, why: str) -> None:
        try:
            if text is None:
                raise ConfigurationError(why)
            offer = read_offer(text)
        except ConfigurationError as error:
            log.warning("No settings to offer: %s", error)
            self.happened(SettingsRead(None, str(error)))
        else:
            log.info("Settings to offer generation=%d", offer.generation)
            self.happened(SettingsRead(offer))

    def _answer(self, text: str | None, _why: str) -> None:
        # Before a robot has asked there is none; only the robot can judge it.
        self.happened(AnswerRead(text if text is not None and len(text) <= MAX_ANSWER else ""))

    def _handover(self, text: str | None, _why: str) -> None:
        # A handover that an earlier agent of this pod has already answered must not move the robot again.
        name = (text or "").strip()
        if not name or age_s(Path(self.handover_file)) >= LEAVING_S:
            return
        if HANDOVER.fullmatch(name):
            self.happened(HandoverAsked(name))
        else:
            log.warning("%s holds no name of a handover: %.40r", self.handover_file, name)
