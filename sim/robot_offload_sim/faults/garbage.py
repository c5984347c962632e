"""Garbage and other versions in every channel of both sessions, beside the messages of the two sides.

The messages themselves are unchanged. Beside some of them arrives a faulty copy: of another version, and then with
another meaning; too short, too long, torn, of an undeclared name; or meaningless bytes. None of it is a fault: it
excuses no broken promise.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from robot_offload_core.data import probe
from robot_offload_core.data.process import RELAY
from robot_offload_core.data.states import CHANNEL
from robot_offload_core.fence import envelope
from robot_offload_core.relay.goals import words
from robot_offload_core.topics import snapshots
from robot_offload_core.words import beats
from robot_offload_core.words.beats import Beat
from robot_offload_core.words.replace import replace
from robot_offload_sim.world.link_model import Link

Arrival = tuple[Any, ...]
Make = Callable[..., Iterator[Arrival]]

SHARE = 0.06
"""Share of messages in the storms."""
FAR = 10_000_000
"""Added to numbers of another version's messages: a side that took them would refuse all later ones as older."""
NAMES = ("nobody", "", "../../x", "x" * 300)
STRANGE: tuple[Any, ...] = (None, -1, 1.5, [], {"a": None}, "x" * 3000, True)
"""Values that no field of a probe may have; only notes may be as long."""


def let_in(link: Link, share: float = SHARE) -> None:
    """Let garbage arrive on every wire from now on, with this share of the messages."""

    def beside(make: Make, dice: random.Random, *args: Any) -> Iterator[Arrival]:
        return make(dice, *args) if dice.random() < share else iter(())

    for session, make in ((link.pulse, beats_beside), (link.data, data_beside)):
        for wire in (session.up, session.down):
            wire.beside = partial(beside, make)


def beats_beside(dice: random.Random, sent: Beat | str, sent_true_s: float) -> Iterator[Arrival]:
    """Yield what arrives beside a beat."""
    beat = sent if isinstance(sent, Beat) else beats.decode(sent)
    later = beats.encode(replace(beat, sent_us=beat.sent_us + FAR, sequence=beat.sequence + FAR))
    _, _, rest = later.partition(" ")
    spoiled: tuple[str, ...] = (
        f"{int(beats.VERSION) + 1} {rest}", f"0 {rest}", f"{later} 1", f"{later}\0", later.replace(" ", "  "),
        later[: later.rindex(" ")], "\N{BELL}" + later, later * 20, "",
    )  # fmt: skip
    yield dice.choice(spoiled), sent_true_s


def data_beside(dice: random.Random, channel: str, header: bytes, payload: Any) -> Iterator[Arrival]:
    """Yield what arrives beside a message of the data session."""
    if channel == "probe":
        yield channel, header, spoiled_probe(dice, payload)
    elif channel == RELAY:
        yield channel, header, spoiled_letter(dice, payload)
    elif channel != "effect":  # a stand-in for a request, which has no bytes here
        kind, _, _ = channel.partition("/")
        yield f"{kind}/{dice.choice(NAMES)}", header, payload
        yield channel, spoiled_header(dice, header), payload
        if channel.startswith(CHANNEL):
            yield channel, header, spoiled_snapshot(dice, payload)


def spoiled_header(dice: random.Random, good: bytes) -> bytes:
    """Return a header that is not an envelope header of this version."""
    opened = envelope.decode(good)
    later = envelope.encode(replace(opened, sequence=opened.sequence + FAR))
    return _spoiled(dice, (b"RO2" + later[3:], later[:3] + b"\x80" + later[4:]), later)


def spoiled_probe(dice: random.Random, good: bytes) -> bytes:
    """Return bytes that are not a probe of this version; a probe of another version is another agent's."""
    body = json.loads(good)
    types = dict.fromkeys(body.get("t", {}), "another/msg/Type")
    other = body | {"v": probe.VERSION + 1, "d": "another", "h": "another", "t": types}
    strange = body | {dice.choice(sorted(body.keys() - {"v", "s"})): dice.choice(STRANGE)}
    shapes = (json.dumps(other), json.dumps(strange), json.dumps([body]), "[" * 5000)
    return _spoiled(dice, tuple(text.encode() for text in shapes), good)


def spoiled_letter(dice: random.Random, good: bytes) -> bytes:
    """Return bytes that are not a relay frame of this version; one of another version is an unknown relay's."""
    frame = words.decode(good)
    stranger = words.encode(replace(frame, writer="ee" * 16))
    unknown = bytearray(good)
    unknown[words.HEAD.size - 1] = 250
    return _spoiled(dice, (stranger[:3] + b"\xff" + stranger[4:], bytes(unknown)), good)


def spoiled_snapshot(dice: random.Random, good: bytes) -> bytes:
    """Return a damaged snapshot."""
    at = good.index(snapshots.MAGIC) + len(snapshots.MAGIC)
    other = good[:at] + b"\xff" + good[at + 1 :]
    return _spoiled(dice, (other, good[:-5] + b"\xa5" + good[-4:]), good[: at + 2])


def _spoiled(dice: random.Random, shapes: tuple[bytes, ...], good: bytes) -> bytes:
    """Return one of these shapes, or a damaged message: a part of it, more than it, or arbitrary bytes."""
    wrong: tuple[Callable[[], bytes], ...] = (
        lambda: good[: dice.randrange(len(good))], lambda: good + b"\0", lambda: dice.randbytes(len(good)), bytes,
    )  # fmt: skip
    return dice.choice(shapes) if dice.random() < 0.6 else dice.choice(wrong)()
