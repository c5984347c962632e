"""What a hostile relay writes: words that are read and mean nothing good, and bytes that are no words."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import fields
from typing import Any, get_type_hints

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals import words
from robot_offload_core.relay.goals.ports import Face, GoalStatus

NAMES = ("", "odom", "command", "walker", "../../x", "os", "x" * 300)
NUMBERS = (0, 1, 2, 7, 2**31, 2**63, 2**64 - 1)


def spoiled(good: bytes, chance: random.Random) -> bytes:
    """A good message with something wrong, or nothing good at all."""
    kind = chance.randrange(5)
    if kind == 0:
        return good[: chance.randrange(len(good))] if good else b""
    if kind == 1:
        return chance.randbytes(chance.randrange(200))
    if kind == 2:
        place = chance.randrange(len(good))
        return good[:place] + chance.randbytes(3) + good[place:]
    return good + chance.randbytes(4) if kind == 3 else good.replace(b"1", b"9", 1)


def anything(kind: object, names: tuple[str, ...], tokens: tuple[Token, ...], chance: random.Random) -> Any:
    """A value of a field of a word: names and tokens that exist and others, numbers at the ends."""
    number = chance.choice(NUMBERS)
    text = chance.choice(NAMES + names)
    values: dict[object, Any] = {
        str: text, int: number, bool: number % 2 == 0, bytes: chance.randbytes(chance.choice([0, 1, 16, 60, 20_000])),
        Site: chance.choice(list(Site)), Face: chance.choice(list(Face)), GoalStatus: chance.choice(list(GoalStatus)),
        words.CallVerdict: chance.choice(list(words.CallVerdict)),
        Token: chance.choice((*tokens, Token("cd" * 16, number, ""), Token("", number, "ab" * 16))),
        tuple[str, ...]: (text, *names), tuple[int, ...]: (number, 1, 2, 3),
    }  # fmt: skip
    return values[kind]


def letters(
    writer: str, reader: str, agent: str, names: tuple[str, ...], chance: random.Random,
    tokens: tuple[Token, ...] = (), rounds: int = 60,
) -> Iterator[bytes]:  # fmt: skip
    """Frames of a relay that is known; attempts come back, so that words of one follow each other."""
    yield words.encode(words.RelayFrame(writer, "", 0, words.Hello(agent, Site.CLOUD, 1, names)))
    attempts = [chance.randbytes(16) for _ in range(5)]
    number = 0
    for _ in range(rounds):
        for kind in words.KINDS:
            hints = get_type_hints(kind)
            values = {each.name: anything(hints[each.name], names, tokens, chance) for each in fields(kind)}
            if "attempt" in values:
                values["attempt"] = chance.choice(attempts)
            if kind is words.Hello:
                values["agent"] = chance.choice([agent, ""])
            number += 1
            good = words.encode(words.RelayFrame(writer, reader, chance.choice([0, number]), kind(**values)))
            yield good if chance.random() < 0.7 else spoiled(good, chance)
