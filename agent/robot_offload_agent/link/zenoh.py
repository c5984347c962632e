"""The agents' own link: one mutually authenticated Zenoh session, dialled by the robot.

Every connection is a session of its own. Whatever ends it (lease, `reopen`, the cloud's restart), the robot closes the
session and opens another, so that nothing buffered survives, certificates are read anew and the peer is checked again.
The cloud's listener stays for the life of the process: a QUIC port that a robot still dials is not free again for half
a minute after the listener was closed.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Sequence

import zenoh

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link import zenoh_causes
from robot_offload_agent.link.certificate_files import certificate_problem
from robot_offload_agent.link.port import Channel, LinkCause, LinkStatus, OnMessage, OnRoom, no_room
from robot_offload_agent.link.zenoh_causes import Found
from robot_offload_agent.link.zenoh_config import ZenohSettings, key
from robot_offload_agent.link.zenoh_lane import LargeLane
from robot_offload_agent.link.zenoh_log import WheelLog
from robot_offload_agent.link.zenoh_rules import Attendance, EndpointChoice, Patience, Repetition
from robot_offload_agent.link.zenoh_session import PeerRefusedError, ZenohSession
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.words.reasons import Reason

log = logging.getLogger(__name__)

NO_ROBOT = "no robot is connected"
_CLOSE_S = 0.9
"""How long `close` waits for the session to say goodbye."""
_SUCCESSION_S = 1.0
"""How long a second session may stay silent before it takes over from the first anyway."""
_LOOK_S = 0.5
"""Interval at which the cloud checks who is connected."""
_LOG_S = 0.05
"""How long to wait for a failed attempt's line in the wheel's log."""
_REFUSAL_S = 60.0
"""How long a refused robot stays in the status of a cloud without one."""


class ZenohLink:
    """See `port.Link`. All methods are safe to call from any thread, before and after the link is up.

    Attributes:
        settings: as given.
    """

    def __init__(
        self,
        settings: ZenohSettings,
        channels: Sequence[Channel],
        on_message: OnMessage,
        wheel: WheelLog | None = None,
        on_room: OnRoom = no_room,
    ) -> None:
        """Check everything that can be checked without a network.

        Args:
            settings: of the link.
            channels: the same as on the other side.
            on_message: see `port.OnMessage`.
            wheel: the log that states why a session was refused; without it that is not known.
            on_room: see `port.OnRoom`.

        Raises:
            ConfigurationError: a certificate file is missing or does not fit, or a channel has no usable name.
        """
        names = [channel.name for channel in channels]
        for name in names:
            key(settings, settings.side, name)
        if len(set(names)) != len(names):
            raise ConfigurationError(f"channels {', '.join(names)}: each name once")
        problem = certificate_problem(settings)
        if problem:
            raise ConfigurationError(problem)
        self.settings = settings
        self._channels = tuple(channels)
        self._names = frozenset(names)
        self._on_message = on_message
        self._choice = EndpointChoice(bool(settings.fallback), settings.fallback_after_ms / 1e3)
        self._patience = Patience(settings.open_timeout_ms, settings.slow_open_timeout_ms)
        self._wheel = wheel
        self._on_room = on_room
        self._large = LargeLane(settings, channels, on_room)
        self._attendance = Attendance()
        self._repetition = Repetition()
        self._counters: Counter[str] = Counter()
        self._change = threading.Condition()
        self._thread: threading.Thread | None = None
        # The following is guarded by _change; the sessions may be read without.
        self._session: ZenohSession | None = None
        self._successor: ZenohSession | None = None
        self._earlier_sessions = 0
        self._earlier_malformed = 0
        self._message = "not started"
        self._cause = LinkCause.NONE
        self._refused: tuple[str, float] = ("", float("-inf"))  # a robot that was refused, and when
        self._reopening = ""
        self._closing = False

    def start(self) -> None:
        """Start connecting (robot) or listening (cloud) in the background and return at once."""
        if self._thread is not None:
            raise RuntimeError("the link was started already")
        work = self._dial if self.settings.dials else self._listen
        if self._wheel is not None and not self.settings.dials:
            self._wheel.watch(self._handshake_failed)
        self._thread = threading.Thread(target=work, name=f"link-{self.settings.session}", daemon=True)
        self._thread.start()

    def send(self, channel: str, header: bytes, payload: bytes) -> bool:
        """Pass a message to the transport; see `port.Link.send`.

        Raises:
            KeyError: no such channel.
        """
        if channel not in self._names:
            raise KeyError(f"channel {channel!r} is not one of {', '.join(sorted(self._names))}")
        session = self._session
        if session is None or not self._up(session):
            return False
        sent = self._large.session_for(channel, len(payload), session).send(channel, header, payload)
        self._large.note(channel, sent=sent)
        return sent

    def _up(self, session: ZenohSession) -> bool:
        return session.connections > 0 and not self._reopening and not self._is_foreign(session)

    def _is_foreign(self, session: ZenohSession) -> bool:
        """Return whether the cloud at the other end has stated that it serves another RobotOffload."""
        return session.served_uid not in ("", self.settings.uid)

    def status(self) -> LinkStatus:
        """Return the present state."""
        with self._change:
            session = self._session
            connected = session is not None and self._up(session)
            cause, message = self._judge(session, connected)
            return LinkStatus(
                connected=connected,
                endpoint=self._where(self._choice.fallback),
                fallback=self._choice.fallback,
                sessions=self._earlier_sessions + (session.opened if session is not None else 0),
                message=message,
                cause=cause,
                counters=tuple(sorted(self._counters.items())),
            )

    def _judge(self, session: ZenohSession | None, connected: bool) -> tuple[LinkCause, str]:
        """Return the present problem; call with _change held."""
        if self.settings.dials and session is not None and self._is_foreign(session):
            return LinkCause.OTHER_IDENTITY, zenoh_causes.other_identity(self.settings, session.served_uid)
        if connected and self._choice.fallback and self.settings.dials:
            return LinkCause.UDP_BLOCKED, zenoh_causes.udp_blocked(self.settings, self._where(fallback=True))
        if self.settings.dials:
            return (LinkCause.NONE, "") if connected else (self._cause, self._message)
        return self._cause, "" if connected and not self._cause else self._message

    def _where(self, fallback: bool) -> str:
        return ", ".join(self.settings.fallback if fallback else self.settings.endpoints)

    @property
    def malformed(self) -> int:
        """How many invalid messages arrived so far."""
        with self._change:
            return self._earlier_malformed + (self._session.malformed if self._session is not None else 0)

    def reopen(self, reason: str) -> None:
        """See `port.Link.reopen`. The cloud keeps its listener: the robot connects anew."""
        with self._change:
            if self.settings.dials and self._session is not None and not self._reopening:
                log.info("Reopened the %s session reason=%s", self.settings.session, reason)
                if reason == Reason.INPUT_STALE:
                    self._large.came_late()
                self._reopening = reason or "asked to"
                self._message = f"reopening: {self._reopening}"
                self._change.notify_all()

    def close(self) -> None:
        """End the session and its threads for good; return within about a second."""
        self._large.close()
        with self._change:
            self._closing = True
            self._change.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(_CLOSE_S)

    # -- the robot --------------------------------------------------------------------------------------------------

    def _dial(self) -> None:
        while not self._closing:
            began_s = now_s()
            session = self._open(self._choice.fallback)
            if session is None:
                if self._choice.failed(began_s, now_s()):
                    log.warning("Changed to %s", self._where(self._choice.fallback))
                self._pause(self.settings.retry_ms / 1e3)
                continue
            self._begin(session)
            self._stay()
        self._end_session("closed", wait_s=_CLOSE_S / 2)

    def _stay(self) -> None:
        """Return when the session has ended, for any reason."""
        while True:
            with self._change:
                # On the fallback the primary is tried again from time to time.
                left_s = self.settings.primary_retry_s if self._choice.fallback else None
                self._change.wait_for(self._session_over, left_s)
                if self._session_over():
                    break
            if (session := self._open(fallback=False)) is not None:
                self._succeed(session)
        if not self._closing and not self._reopening:
            log.warning("Lost the %s session with %s", self.settings.session, self._where(self._choice.fallback))
        self._end_session(f"reopening: {self._reopening}" if self._reopening else "the session was lost")

    def _session_over(self) -> bool:
        # With a foreign cloud the session stays: dialling again would lead to the same one.
        return self._closing or self._session is None or self._session.connections == 0 or bool(self._reopening)

    def _begin(self, session: ZenohSession) -> None:
        """Use a session where there is none."""
        with self._change:
            self._session = session
            self._reopening = ""
            self._choice.opened(session.fallback)
        self._declare(session)
        what = "Opened" if self.settings.dials else "Listened for"
        log.info("%s the %s session endpoint=%s", what, self.settings.session, self._where(session.fallback))

    def _succeed(self, session: ZenohSession) -> None:
        """Let a second session replace the present one once it delivers, so that no silence lies between.

        The message that shows it may have come by the first as well: one of a channel may be doubled.
        """
        with self._change:
            self._successor = session
        self._declare(session)
        with self._change:
            self._change.wait_for(lambda: self._successor is None or self._session_over(), _SUCCESSION_S)
            if self._successor is None:
                return
            if session.connections > 0 and not self._closing and not self._reopening:
                self._promote(session)  # nobody says anything at present, or the first has ended meanwhile
                return
            self._successor = None
        self._retire(session)

    def _promote(self, session: ZenohSession) -> None:
        """Call with _change held."""
        old, self._session = self._session, session
        self._successor = None
        self._choice.opened(session.fallback)
        log.info("Changed to %s for the %s session", self._where(session.fallback), self.settings.session)
        if old is not None:
            self._retire(old)
        self._change.notify_all()

    def _end_session(self, message: str, wait_s: float = 0.0) -> None:
        self._large.drop()
        with self._change:
            old, self._session = self._session, None
            self._message = message
        if old is not None:
            self._retire(old).join(wait_s)

    def _retire(self, session: ZenohSession) -> threading.Thread:
        """Close a session in the background, because closing may hang as long as the network does."""
        with self._change:
            self._earlier_sessions += session.opened
            self._earlier_malformed += session.malformed
        thread = threading.Thread(target=session.close, name=f"link-{self.settings.session}-close", daemon=True)
        thread.start()
        return thread

    # -- the cloud --------------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        while not self._closing:
            session = self._open(fallback=False)
            if session is None:
                self._pause(self.settings.retry_ms / 1e3)
                continue
            with self._change:
                self._message = NO_ROBOT
            self._begin(session)
            while not self._closing:
                self._pause(_LOOK_S)
                self._look(session, now_s())
        self._end_session("closed", wait_s=_CLOSE_S / 2)

    def _look(self, session: ZenohSession, now: float) -> None:
        """Judge who is connected; send a silent robot the uid that this cloud serves."""
        settings = self.settings
        with self._change:
            sessions, strangers = session.connections, session.strangers
            cause = self._attendance.look(now, sessions, session.received)
            message = "" if sessions else NO_ROBOT
            if cause is LinkCause.SECOND_SESSION:
                message = zenoh_causes.second_session(settings, sessions)
                self._counters["second_session"] = self._attendance.seconds
            elif cause is LinkCause.OTHER_IDENTITY:
                message = zenoh_causes.silent_robot(settings)
            elif not sessions and strangers:
                cause, message = LinkCause.STRANGER, zenoh_causes.stranger(settings, strangers)
            elif not sessions and now - self._refused[1] < _REFUSAL_S:
                cause, message = LinkCause.CERTIFICATE_REFUSED, self._refused[0]
            self._cause, self._message = cause, message
            self._counters["strangers"] = session.foreign
        if cause is LinkCause.OTHER_IDENTITY:
            session.introduce()
        if strangers:
            message = zenoh_causes.stranger(settings, strangers)
        if (cause or strangers) and self._repetition.is_due(message, now):
            log.warning("%s", message)

    def _handshake_failed(self, found: Found) -> None:
        """Record that a handshake at a listener of this process failed (thread of the log)."""
        message = zenoh_causes.explain(found, self.settings, self._where(fallback=False))
        with self._change:
            self._counters["refused"] += 1
            self._refused = message, now_s()
        if self._repetition.is_due(message, now_s()):
            log.warning("%s", message)

    # -- both -------------------------------------------------------------------------------------------------------

    def _open(self, fallback: bool) -> ZenohSession | None:
        """Make one attempt and return its session; the reason of a failure becomes the status message."""
        where, began_s = self._where(fallback), now_s()
        try:
            session = ZenohSession(self.settings, fallback, self._patience.next_ms(now_s()))
            self._patience.succeeded()
            return session
        except PeerRefusedError as error:
            found = Found(LinkCause.WRONG_NAME, str(error))
        except zenoh.ZError as error:
            found = self._failure(error, fallback, began_s)
        if found.cause in (LinkCause.CANNOT_LISTEN, LinkCause.CERTIFICATE_FILES):
            message = found.detail
        else:
            message = zenoh_causes.explain(found, self.settings, where)
        with self._change:
            if self._session is None:
                self._cause, self._message = found.cause, message
                if self._repetition.is_due(message, now_s()):
                    log.warning("%s reason=%s", message, found.cause.value)
        return None

    def _failure(self, error: zenoh.ZError, fallback: bool, began_s: float) -> Found:
        """Return why an attempt failed."""
        if not self.settings.dials:
            # The wheel appends its source line.
            where = self._where(fallback)
            return Found(LinkCause.CANNOT_LISTEN, f"cannot listen on {where}: {str(error).partition(' at /')[0]}")
        problem = certificate_problem(self.settings)
        if problem:
            return Found(LinkCause.CERTIFICATE_FILES, problem)
        endpoints = self.settings.fallback if fallback else self.settings.endpoints
        said = [] if self._wheel is None else self._wheel.dialled(endpoints, began_s, _LOG_S)
        return zenoh_causes.most_telling(said) or Found(LinkCause.NO_SESSION, "")

    def _declare(self, session: ZenohSession) -> None:
        session.on_room = self._on_room
        try:
            session.declare(self._channels, self._deliver, self._connection_changed)
        except zenoh.ZError as error:
            session.connections = 0
            log.warning("The %s session ended as soon as it was open: %s", self.settings.session, error)

    def _pause(self, duration_s: float) -> None:
        with self._change:
            self._change.wait_for(lambda: self._closing, duration_s)

    # -- on threads of the wheel ------------------------------------------------------------------------------------

    def _deliver(self, session: ZenohSession, channel: str, header: bytes, payload: bytes) -> None:
        if session is self._successor:
            with self._change:
                if session is self._successor:
                    self._promote(session)
        if session is not self._session or self._reopening:
            return  # stale: from a session that is being closed
        try:
            self._on_message(channel, header, payload)
        except Exception:
            log.exception("Handling a message of channel %s failed", channel)

    def _connection_changed(self, session: ZenohSession) -> None:
        fallback = session.protocols() == {"tls"}
        with self._change:
            self._change.notify_all()
            if session is not self._session or self.settings.dials:
                return
            self._choice.opened(fallback)
            log.info("Counted connections session=%s robots=%d", self.settings.session, session.connections)
