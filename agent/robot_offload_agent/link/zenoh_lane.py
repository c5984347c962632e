"""A separate session for large messages: TLS over TCP, if the robot's TCP bears lost packets.

The wheel's QUIC takes a lost packet for a full link (Cubic) and has no other setting: at 10 ms round trip
0.1 % of lost packets leave it a third of 9 MB/s. The robot's kernel may do better (BBR), and then large messages go
through its TCP, on the port where the cloud listens for the fallback. They never hold up the small ones, which stay
where they are. The session is used only if QUIC does not carry them: a narrow link without loss gains nothing. The
measurements are in docs/decisions/0010-large-messages.md.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import zenoh

from robot_offload_agent.link.port import Channel, OnRoom, no_room
from robot_offload_agent.link.zenoh_config import ZenohSettings
from robot_offload_agent.link.zenoh_rules import Struggle
from robot_offload_agent.link.zenoh_session import PeerRefusedError, ZenohSession
from robot_offload_agent.runtime.clock import now_s

log = logging.getLogger(__name__)

LARGE_BYTES = 32 * 1024
"""A channel with a message above this is one of large messages: images, point clouds, maps."""
CONGESTION_CONTROL = Path("/proc/sys/net/ipv4/tcp_congestion_control")
_KEPT_S = 60.0
"""How long after the end of a session it is remembered that QUIC did not carry the large messages."""
_RETRY_S = 1.0
_LONGEST_RETRY_S = 10.0


def bears_loss() -> bool:
    """Return whether new TCP connections of this network namespace bear lost packets."""
    try:
        return CONGESTION_CONTROL.read_text(encoding="ascii").startswith("bbr")
    except OSError:
        return False


class LargeLane:
    """The robot's session for large messages, opened beside the session over QUIC if that does not carry them."""

    def __init__(self, settings: ZenohSettings, channels: Sequence[Channel], on_room: OnRoom = no_room) -> None:
        """Open nothing yet.

        Args:
            settings: of the link.
            channels: those of the link.
            on_room: see `port.OnRoom`.
        """
        self._settings = settings
        self._on_room = on_room
        self._channels = tuple(channels)
        self._usable = settings.dials and settings.session == "data" and bool(settings.fallback) and bears_loss()
        self._struggles: dict[str, Struggle] = {}  # of the channels with large messages
        self._change = threading.Condition()
        self._thread: threading.Thread | None = None
        # Set by the thread alone, read by all.
        self._session: ZenohSession | None = None
        # Changed with _change held.
        self._wanted = False
        self._kept_until_s = float("-inf")
        self._dropped = 0
        self._closing = False

    def session_for(self, channel: str, size: int, main: ZenohSession) -> ZenohSession:
        """Return the session that carries a message.

        Args:
            channel: its name.
            size: of the message, bytes.
            main: the link's session.
        """
        if self._usable and size > LARGE_BYTES and channel not in self._struggles:
            self._struggles[channel] = Struggle()
        if channel not in self._struggles:
            return main
        if main.fallback:  # both would be the same
            if self._wanted:
                self._want(False)
            return main
        if not self._wanted and now_s() < self._kept_until_s:
            self._want(True)
        session = self._session
        return session if session is not None and session.connections > 0 else main

    def note(self, channel: str, *, sent: bool) -> None:
        """Record whether a message was sent: if QUIC carries all of a topic, it stays there."""
        struggle = self._struggles.get(channel)
        if struggle is not None and not self._wanted and struggle.note(now_s(), sent=sent):
            self._want(True)

    def _want(self, wanted: bool) -> None:
        with self._change:
            self._wanted = wanted
            if wanted and self._thread is None and not self._closing:
                self._thread = threading.Thread(target=self._run, name="link-large", daemon=True)
                self._thread.start()
            self._change.notify_all()

    def drop(self) -> None:
        """End the session with what is buffered in it; soon afterwards the next large message opens another."""
        with self._change:
            self._dropped += 1
            if self._wanted:
                self._kept_until_s = now_s() + _KEPT_S
        for struggle in tuple(self._struggles.values()):
            struggle.refused = False  # what a cut refused is no sign of anything
        self._want(False)

    def came_late(self) -> None:
        """Record that an input was too old in the cloud while the link was there: QUIC did not carry the large ones.

        So the next large message opens the session: to learn that again from refusals takes seconds.
        """
        if self._usable and self._struggles:
            with self._change:
                self._kept_until_s = now_s() + _KEPT_S

    def close(self) -> None:
        """End it for good; return at once."""
        with self._change:
            self._closing = True
            self._change.notify_all()

    # -- the thread ---------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        retry_s, dropped = _RETRY_S, self._dropped

        def over() -> bool:
            return not self._wanted or self._dropped != dropped

        while not self._closing:
            if over():
                self._until(lambda: self._wanted)
                retry_s, dropped = _RETRY_S, self._dropped
                continue
            session = self._open()
            if session is None:
                self._until(over, retry_s)
                retry_s = min(2 * retry_s, _LONGEST_RETRY_S)
            else:
                retry_s = _RETRY_S
                self._use(session, over)

    def _until(self, condition: Callable[[], bool], limit_s: float | None = None) -> None:
        with self._change:
            self._change.wait_for(lambda: condition() or self._closing, limit_s)

    def _open(self) -> ZenohSession | None:
        settings = self._settings
        try:
            session = ZenohSession(settings, True, settings.open_timeout_ms)
        except (PeerRefusedError, zenoh.ZError) as error:
            log.debug("No session for large messages came about: %s", error)
            return None
        session.on_room = self._on_room
        try:
            session.speak(self._channels, self._ended)
        except zenoh.ZError:
            session.close()
            return None
        return session

    def _use(self, session: ZenohSession, over: Callable[[], bool]) -> None:
        """Return when the session has ended or is no longer wanted."""
        log.info("Opened a session for large messages endpoint=%s", ", ".join(self._settings.fallback))
        self._session = session
        self._until(lambda: over() or session.connections == 0)
        self._session = None
        # In the background, because closing may hang as long as the network does.
        threading.Thread(target=session.close, name="link-large-close", daemon=True).start()

    def _ended(self, _: ZenohSession) -> None:
        with self._change:
            self._change.notify_all()
