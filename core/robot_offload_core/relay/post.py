"""A relay's post: letters and hellos over the data session; invalid frames are counted, a replaced relay is noticed."""

from __future__ import annotations

from collections import Counter

from robot_offload_core.fence.token import Token
from robot_offload_core.relay.goals import words
from robot_offload_core.relay.goals.courier import Courier
from robot_offload_core.relay.goals.ports import RelayPorts
from robot_offload_core.relay.goals.words import Hello, Word, WordError
from robot_offload_core.words.messages import Letters
from robot_offload_core.words.veil import veil_token

HELLO_S = 0.1
"""Interval of the hellos, by which one relay shows the other that it lives."""
HEARD_S = 0.35
"""Without a hello for this long (three may be lost) the other relay is not heard."""


class Post:
    """One relay's connection to the other: sends and takes letters and hellos.

    Attributes:
        agent: incarnation of the control process whose relay is listened to; "" for none.
        hello, hello_s: the newest hello of the other relay, and its arrival.
        veils: what is written names the robot by the hash of its incarnation (veil.py); in the cloud.
        known_s: since when the other relay has known this one and has been heard without a break; inf: it does not.
    """

    def __init__(self, incarnation: str, ports: RelayPorts) -> None:
        self.ports = ports
        self.courier = Courier(incarnation)
        self.agent = ""
        self.veils = True
        self.hello: Hello | None = None
        self.hello_s = float("-inf")
        self.known_s = float("inf")
        self.hello_due_s = ports.now_s()
        self.said: Hello | None = None
        self.counters: Counter[str] = Counter()
        self.problem: tuple[str, str] | None = None

    def heard(self) -> bool:
        """Return whether the other relay is heard."""
        return self.hello is not None and self.ports.now_s() - self.hello_s <= HEARD_S

    def write(self, word: Word) -> None:
        """Write a letter; repeat it until it is acknowledged."""
        for frame in self.courier.write(word, self.ports.now_s()):
            self._cross(frame)

    def named(self, token: Token) -> Token:
        """Return a token as the cloud writes it."""
        return veil_token(token) if self.veils else token

    def write_once(self, word: Word) -> None:
        """Write a word that may be lost."""
        if self.courier.peer:
            self._cross(self.courier.once(word))

    def take(self, data: bytes) -> tuple[Word | None, bool]:
        """Take a frame; return its word, or None if it is not for this relay, and whether a new relay wrote it."""
        try:
            frame = words.decode(data)
        except WordError as error:
            self.counters["garbage"] += 1
            if error.reason == "OtherVersion":
                self.problem = error.reason, f"The other side's agent is of another release: {error}"
            return None, False
        if not isinstance(frame.word, Hello):
            return self.courier.take(frame), False
        if not self.agent or frame.word.agent != self.agent or frame.writer in self.courier.gone or frame.number:
            self.counters["foreign"] += 1
            return None, False
        self.problem = None
        heard, now_s = self.heard(), self.ports.now_s()
        met = self.courier.meet(frame.writer)
        if frame.reader != self.courier.mine:
            self.known_s = float("inf")
        elif met or not heard:
            self.known_s = now_s
        else:
            self.known_s = min(self.known_s, now_s)
        self.hello, self.hello_s = frame.word, now_s
        return frame.word, met

    def turn(self, hello: Hello) -> None:
        """Send what is due: acknowledgements, letters again, a hello at changes and each 100 ms."""
        now_s = self.ports.now_s()
        for frame in self.courier.due(now_s):
            self._cross(frame)
        if now_s >= self.hello_due_s or hello != self.said:
            self.said, self.hello_due_s = hello, now_s + HELLO_S
            self._cross(self.courier.once(hello))

    def due_s(self) -> float:
        """Return when `turn` has something to send."""
        return min(self.hello_due_s, self.courier.due_s())

    def _cross(self, frame: bytes) -> None:
        self.counters["written"] += 1
        self.ports.send("data", Letters(frame))
