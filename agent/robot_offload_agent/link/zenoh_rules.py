"""Three small rules of the Zenoh link, without sessions, threads or clocks."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from robot_offload_agent.link.port import LinkCause

LATEST_SHARE = 2.5
"""If the newest counts: a message on its way for this many times the shortest time is waiting behind others.

A lost packet is noticed an eighth of a round trip late and costs one more (RFC 9002, section 6.1.2): 2.125 times the
shortest time on a link that is not full. With 1.5 each lost packet held up the next message as well."""
GROWTH = 1.01
"""The shortest time of the past is forgotten at this pace: a link may become longer."""


@dataclass
class EndpointChoice:
    """Primary or fallback: alternates while neither gives a session.

    Attributes:
        has_fallback: whether there is anything to choose from.
        patience_s: how long one of the two is tried before it is the other's turn.
        fallback: whether the fallback is in use or being tried.
        tries: attempts that failed since the last session or change.
        since_s: when the first of them began.
    """

    has_fallback: bool
    patience_s: float
    fallback: bool = False
    tries: int = 0
    since_s: float = 0.0

    def failed(self, began_s: float, now_s: float) -> bool:
        """Record an attempt without success; return whether it is the other's turn now."""
        if self.tries == 0:
            self.since_s = began_s
        self.tries += 1
        # Two at least: one attempt may take longer than the patience, and one lost packet does not mean a blocked port.
        if not self.has_fallback or self.tries < 2 or now_s - self.since_s < self.patience_s:
            return False
        self.opened(not self.fallback)
        return True

    def opened(self, fallback: bool) -> None:
        """Record the one in use; when that session ends it is tried first."""
        self.fallback, self.tries = fallback, 0


@dataclass
class Patience:
    """How long one attempt to open a session may take.

    A short one finds a restored link at once, but opening takes about three round trips: on a path of half a
    second a short one never succeeds. So if short ones have failed for a while, every second one is long.

    Attributes:
        short_ms, long_ms: the two lengths.
        short_only_s: how long only short ones are tried; longer than the outages after which speed matters.
        began_s: when the first of the present row of failed attempts began; None: the last one succeeded.
        tries: attempts since then.
    """

    short_ms: int
    long_ms: int
    short_only_s: float = 12.0
    began_s: float | None = None
    tries: int = 0

    def next_ms(self, now_s: float) -> int:
        """Return the limit of the attempt that begins now."""
        if self.began_s is None:
            self.began_s = now_s
        self.tries += 1
        long = now_s - self.began_s > self.short_only_s and self.tries % 2 == 0
        return self.long_ms if long else self.short_ms

    def succeeded(self) -> None:
        """Record a session."""
        self.began_s, self.tries = None, 0


@dataclass
class Struggle:
    """Whether a session carries less of a channel than is put in, although the link is there.

    A cut refuses messages too, but then the session ends. So the class counts how often a refusal was followed by a
    message that was taken again.

    Attributes:
        window_s: time in which they are counted.
        enough: number of such turns that proves it.
        refused: the newest message was refused.
        turns_s: when messages were taken again.
    """

    window_s: float = 10.0
    enough: int = 3
    refused: bool = False
    turns_s: deque[float] = field(default_factory=deque)

    def note(self, now_s: float, *, sent: bool) -> bool:
        """Record whether a message was sent; return whether the session struggles."""
        if sent and self.refused:
            self.turns_s.append(now_s)
        self.refused = not sent
        while self.turns_s and now_s - self.turns_s[0] > self.window_s:
            self.turns_s.popleft()
        return len(self.turns_s) >= self.enough


@dataclass(frozen=True)
class Peer:
    """A client of the cloud's listener: the common name of its certificate, and `quic` or `tls`."""

    name: str
    protocol: str


def robots(peers: Iterable[Peer]) -> int:
    """Return how many robots these sessions of one certificate are.

    Beside one over QUIC a robot has one over TLS for its large messages (see `zenoh_lane`).
    """
    protocols = [peer.protocol for peer in peers]
    lane = "quic" in protocols and "tls" in protocols
    return len(protocols) - lane


@dataclass
class Attendance:
    """Who is connected to the cloud's listener, and whether that is as it should be.

    Attributes:
        changeover_s: how long two sessions of one robot count as the changeover from one to the next, or as one that
            ended without a goodbye.
        silence_s: how long a connected robot may send nothing: its beats and probes take 0.1 s.
        crowded_s, silent_s: since when there have been several sessions, and since when all were silent; None: not.
        received: messages so far, as of `silent_s`.
        seconds: how often there were several sessions for too long.
    """

    changeover_s: float = 5.0
    silence_s: float = 2.0
    crowded_s: float | None = None
    silent_s: float | None = None
    received: int = 0
    seconds: int = 0
    crowded: bool = False

    def look(self, now_s: float, sessions: int, received: int) -> LinkCause:
        """Return the problem of these sessions of the robot's certificate; `received` counts their messages."""
        if sessions == 0 or received != self.received or self.silent_s is None:
            self.silent_s, self.received = (now_s if sessions else None), received
        if sessions < 2:
            self.crowded_s, self.crowded = None, False
        elif self.crowded_s is None:
            self.crowded_s = now_s
        if self.crowded_s is not None and now_s - self.crowded_s > self.changeover_s:
            self.seconds += not self.crowded
            self.crowded = True
            return LinkCause.SECOND_SESSION
        silent = self.silent_s is not None and now_s - self.silent_s > self.silence_s
        return LinkCause.OTHER_IDENTITY if silent else LinkCause.NONE


@dataclass
class Repetition:
    """Logs a sentence once, and again from time to time while it stays true.

    Attributes:
        period_s: between two times.
        said: when each sentence was last logged.
    """

    period_s: float = 60.0
    said: dict[str, float] = field(default_factory=dict)

    def is_due(self, sentence: str, now_s: float) -> bool:
        """Return whether the sentence is due, and record that it was logged."""
        due = now_s - self.said.get(sentence, float("-inf")) >= self.period_s
        if due:
            self.said = {one: t_s for one, t_s in self.said.items() if now_s - t_s < self.period_s} | {sentence: now_s}
        return due


@dataclass
class Backlog:
    """Bulk messages of one channel that are on their way and not yet acknowledged.

    QUIC keeps what it cannot send yet: on a link of 80 ms and 3 % loss that carries half of what is put in, messages
    arrive 6 seconds old, and no call takes them back. So no more is put in while the oldest is overdue.

    Attributes:
        limit_s: an age of the oldest above which nothing more is admitted.
        forget_s: after this long a message is not waited for: acknowledgements get lost, and a full queue drops
            messages.
        latest: more is put in only while the oldest has hardly taken longer than a message that waits for none needs.
        least_s: time until a message is acknowledged if none is before it; 0: not known.
        refused: a message was refused since there was room.
        sequence: of the newest message.
        waiting: (sequence, time of sending) of each message, oldest first.
    """

    limit_s: float
    forget_s: float
    latest: bool = False
    least_s: float = 0.0
    refused: bool = False
    sequence: int = 0
    waiting: deque[tuple[int, float]] = field(default_factory=deque)

    def admit(self, now_s: float) -> int | None:
        """Return the sequence (1 to 2**32 - 1) for a message that may be sent now, or None."""
        if not self._has_room(now_s):
            self.refused = True
            return None
        self.refused = False
        self.sequence = self.sequence % 0xFFFFFFFF + 1
        self.waiting.append((self.sequence, now_s))
        return self.sequence

    def _has_room(self, now_s: float) -> bool:
        while self.waiting and now_s - self.waiting[0][1] > self.forget_s:
            self.waiting.popleft()
        limit_s = min(self.limit_s, LATEST_SHARE * self.least_s) if self.latest and self.least_s else self.limit_s
        return not self.waiting or now_s - self.waiting[0][1] <= limit_s

    def acknowledged(self, sequence: int, now_s: float) -> bool:
        """Take an arrived message: those sent before it have arrived too, or never will. Unknown ones change nothing.

        Returns:
            Whether there is room again after a refusal.
        """
        if any(sequence == waiting for waiting, _ in self.waiting):
            while (passed := self.waiting.popleft())[0] != sequence:
                pass
            took_s = now_s - passed[1]
            self.least_s = min(took_s, GROWTH * self.least_s) if self.least_s else took_s
        if not self.refused or not self._has_room(now_s):
            return False
        self.refused = False
        return True
