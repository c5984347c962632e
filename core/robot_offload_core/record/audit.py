"""The audit trail: who had a robot's placement, settings or certificate changed, as a chain of hashes. Pure.

Each line is a JSON list `[format, number, at, kind, who, what, previous, digest]`: a number that grows by one, an RFC
3339 time of the system clock, texts, a table of texts, the digest of the previous line, and the SHA-256 of all earlier
elements of this line. To change, remove, insert or move a line, all following lines must be rewritten. A head kept
elsewhere (number and digest of a line) reveals that, and lines cut off at the end.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

FORMAT: Final = 1
BEGINNING: Final = "0" * 64
"""The previous digest in the first line of a trail."""
MAX_TEXT: Final = 1024
"""Characters of a text; longer texts are cut, because they come from outside."""
_DIGEST: Final = re.compile(r"[0-9a-f]{64}")


class Kind(str, Enum):
    """The kind of an entry."""

    START = "Start"
    SETTINGS = "Settings"
    PIN = "Pin"
    OVERRIDE = "Override"
    SWITCH_BY_HAND = "SwitchByHand"
    CERTIFICATE = "Certificate"
    TORN = "Torn"
    MISSED = "Missed"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Head:
    """Number and digest of a line, which together vouch for all lines before it."""

    number: int = 0
    digest: str = BEGINNING

    def __str__(self) -> str:
        return f"{self.number}:{self.digest}"


@dataclass(frozen=True)
class Entry:
    """A line of a trail.

    Attributes:
        head: number and digest of the line.
        previous: digest of the previous line.
        at: RFC 3339 time, by the robot's clock.
        kind: see Kind; a later release may have others.
        who: origin of the change.
        what: details.
    """

    head: Head
    previous: str
    at: str
    kind: str
    who: str
    what: Mapping[str, str]


def line(before: Head, at: str, kind: Kind, who: str, what: Mapping[str, str]) -> tuple[Head, str]:
    """Return the next line of a trail (with its newline) and the new head."""
    texts = {name[:MAX_TEXT]: text[:MAX_TEXT] for name, text in what.items()}
    body = [FORMAT, before.number + 1, at, kind.value, who[:MAX_TEXT], texts, before.digest]
    head = Head(before.number + 1, _digest(body))
    return head, _text([*body, head.digest]) + "\n"


def parse(text: str) -> Entry | None:
    """Parse a line; return None if it is torn, altered or of another format."""
    try:
        body = json.loads(text)
        form, number, at, kind, who, what, previous, digest = body
    except (ValueError, TypeError, RecursionError):
        return None
    texts = [at, kind, who, previous, digest]
    fits = form == FORMAT and type(number) is int and all(isinstance(each, str) for each in texts)
    if not fits or not isinstance(what, dict) or not all(isinstance(each, str) for each in what.values()):
        return None
    if not _DIGEST.fullmatch(previous) or _digest(body[:-1]) != digest:
        return None
    return Entry(Head(number, digest), previous, at, kind, who, what)


def other_format(text: str) -> int | None:
    """Return the format of a line of another version of the agent; None for one of this version or an invalid one."""
    try:
        body = json.loads(text)
    except (ValueError, RecursionError):
        return None
    form = body[0] if isinstance(body, list) and body else None
    return form if type(form) is int and form > 0 and form != FORMAT else None


def parse_head(text: str) -> Head | None:
    """Parse a head, `NUMBER:DIGEST`; return None for anything else."""
    number, _, digest = text.partition(":")
    known = number.isascii() and number.isdigit() and len(number) < 16 and _DIGEST.fullmatch(digest)
    return Head(int(number), digest) if known else None


@dataclass(frozen=True)
class Verdict:
    """The result of a check.

    Attributes:
        entries: number of good lines.
        first, last: number of the first good line (0 if there is none), and the head of the last one.
        problems: sentences; empty: nothing was altered, as far as the lines themselves show.
        torn: the last line is not whole, as after a loss of power.
        others: number of lines written by another version of the agent; they are not checked.
        other: format of the first of those.
    """

    entries: int
    first: int
    last: Head
    problems: tuple[str, ...] = ()
    torn: bool = False
    others: int = 0
    other: int = 0


def verify(lines: Iterable[str], known: Head | None = None) -> Verdict:
    """Check a trail, the oldest line first.

    Args:
        lines: of all files of the trail.
        known: a head that was kept elsewhere; None if there is none.
    """
    problems: list[str] = []
    entries, first, torn = 0, 0, False
    others: list[int] = []
    before: Head | None = None
    found = known is None
    rest = list(lines)
    for position, text in enumerate(rest, start=1):
        entry = parse(text)
        form = other_format(text) if entry is None else None
        if form is not None:
            others.append(form)
            continue
        if entry is None:
            torn = position == len(rest) and not text.endswith("\n")
            if not torn and not _covers_torn(rest[position:]):
                problems.append(f"line {position} was altered, or is none of a trail")
            continue
        if before is None:
            first = entry.head.number
            if entry.head.number == 1 and entry.previous != BEGINNING:
                problems.append(f"line {position}: the first entry names another one before it")
        elif entry.previous != before.digest or entry.head.number != before.number + 1:
            problems.append(f"line {position}: entry {entry.head.number} does not follow entry {before.number}")
        found = found or entry.head == known
        before, entries = entry.head, entries + 1
    if not found and known is not None and not others:  # else it may be among those
        problems.append(_absent(known, first, before))
    return Verdict(entries, first, before or Head(), tuple(problems), torn, len(others), others[0] if others else 0)


def sentences(verdict: Verdict) -> list[str]:
    """Return the findings of a check as sentences for people; the last one names the head to keep."""
    unchecked = _unchecked(verdict)
    if not verdict.entries:
        return [*verdict.problems, *unchecked, "The trail has no entry" if not unchecked else "No line was checked"]
    found = [f"{verdict.entries} entries, {verdict.first} to {verdict.last.number}"]
    found += [f"NOT AS WRITTEN: {problem}" for problem in verdict.problems]
    found += unchecked
    if verdict.torn:
        found.append("the last line is not whole, as a loss of power leaves it")
    if not verdict.problems and not unchecked:
        found.append("in one chain; nothing was altered since the head was seen, if you compared one (--head)")
    return [*found, f"head {verdict.last}"]


def _unchecked(verdict: Verdict) -> list[str]:
    if not verdict.others:
        return []
    lines = "1 line was" if verdict.others == 1 else f"{verdict.others} lines were"
    formats = f"format {verdict.other}, this one reads {FORMAT}"
    return [f"NOT CHECKED: {lines} written by another version of the agent ({formats}); verify with that release"]


def exported(lines: Iterable[str]) -> list[dict[str, object]]:
    """Return the good entries as plain JSON values, for other programs."""
    entries = (parse(text) for text in lines)
    return [
        {"number": e.head.number, "at": e.at, "kind": e.kind, "who": e.who, "what": dict(e.what),
         "digest": e.head.digest}
        for e in entries if e is not None
    ]  # fmt: skip


def _covers_torn(following: list[str]) -> bool:
    """Return whether the next line records that the one before it was found torn."""
    entry = parse(following[0]) if following else None
    return entry is not None and entry.kind == Kind.TORN.value


def _absent(known: Head, first: int, last: Head | None) -> str:
    if last is None or known.number > last.number:
        return f"the trail was cut: it ends before entry {known.number}, which was seen"
    if known.number < first:
        return f"entry {known.number} has gone with the oldest file: the head cannot be compared"
    return f"the trail was written anew: entry {known.number} is another one than was seen"


def _digest(body: list[object]) -> str:
    return hashlib.sha256(_text(body).encode()).hexdigest()


def _text(body: list[object]) -> str:
    return json.dumps(body, separators=(",", ":"), ensure_ascii=True, sort_keys=True)
