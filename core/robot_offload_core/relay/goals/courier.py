"""Carry words between the two relays: a letter is sent until it is acknowledged, and taken once.

A letter is for one reader, by incarnation: a restarted relay takes none meant for its predecessor.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from robot_offload_core.relay.goals import words
from robot_offload_core.relay.goals.words import Ack, Hello, RelayFrame, Word

RESEND_S = 0.1
"""How often a letter is sent again until it is acknowledged."""
WINDOW = 256
"""Numbers that the reader remembers. An older letter is refused, so the writer never sends further ahead than this."""
MAX_GONE = 64


@dataclass
class Letter:
    """A letter on its way. `due_s`: when it is sent again."""

    frame: bytes
    due_s: float


class Courier:
    """One relay's end.

    Attributes:
        mine: incarnation of this relay.
        peer: incarnation of the other relay; "" while none is known.
        gone: incarnations that were replaced: their frames no longer count.
        letters: those not acknowledged, by number.
        acks: numbers still to be acknowledged.
        taken: numbers that arrived.
        highest: highest number that arrived.
    """

    def __init__(self, mine: str) -> None:
        self.mine = mine
        self.peer = ""
        self.gone: OrderedDict[str, None] = OrderedDict()
        self.number = 0
        self.letters: dict[int, Letter] = {}
        self.acks: list[int] = []
        self.taken: set[int] = set()
        self.highest = 0

    def meet(self, peer: str) -> bool:
        """Accept a relay as the peer; return True if it is new. Letters to the former peer are dropped."""
        if peer == self.peer or peer in self.gone:
            return False
        if self.peer:
            self.gone[self.peer] = None
            while len(self.gone) > MAX_GONE:
                self.gone.popitem(last=False)
        self.peer = peer
        self.letters.clear()
        self.acks.clear()
        self.taken.clear()
        self.highest = 0
        return True

    def write(self, word: Word, now_s: float) -> list[bytes]:
        """Queue a message for the peer and return what to send now. Without a peer the message is dropped."""
        if not self.peer:
            return []
        self.number += 1
        letter = Letter(words.encode(RelayFrame(self.mine, self.peer, self.number, word)), now_s)
        self.letters[self.number] = letter
        return self._send(self.number, letter, now_s)

    def once(self, word: Word) -> bytes:
        """Return the frame of a word that is sent once."""
        return words.encode(RelayFrame(self.mine, self.peer, 0, word))

    def due(self, now_s: float) -> list[bytes]:
        """Return what to send now: acknowledgements, and letters again."""
        out = [frame for number, letter in self.letters.items() if letter.due_s <= now_s
               for frame in self._send(number, letter, now_s)]  # fmt: skip
        if self.acks:
            out.append(self.once(Ack(tuple(self.acks[: words.MAX_LIST]))))
            del self.acks[: words.MAX_LIST]
        return out

    def due_s(self) -> float:
        """Return when `due` has something to send."""
        if self.acks:
            return float("-inf")
        lowest = next(iter(self.letters), 0)
        return min((x.due_s for n, x in self.letters.items() if n < lowest + WINDOW), default=float("inf"))

    def take(self, frame: RelayFrame) -> Word | None:
        """Take a frame of the peer; return its word, or None if it is not for this relay or was taken before."""
        if frame.writer != self.peer or not self.peer or isinstance(frame.word, Hello):
            return None
        if frame.reader != self.mine:
            return None
        if isinstance(frame.word, Ack):
            for number in frame.word.numbers:
                self.letters.pop(number, None)
            return None
        if frame.number == 0:
            return frame.word
        if frame.number <= self.highest - WINDOW:
            return None
        self.acks.append(frame.number)
        if frame.number in self.taken:
            return None
        self.taken.add(frame.number)
        self.highest = max(self.highest, frame.number)
        if len(self.taken) > 2 * WINDOW:
            self.taken = {number for number in self.taken if number > self.highest - WINDOW}
        return frame.word

    def _send(self, number: int, letter: Letter, now_s: float) -> list[bytes]:
        if number >= next(iter(self.letters)) + WINDOW:
            return []
        letter.due_s = now_s + RESEND_S
        return [letter.frame]
