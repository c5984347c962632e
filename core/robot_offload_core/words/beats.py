"""The beat that each pulse process sends to the other side fifty times a second, and its text form.

One line of printable text, fields separated by blanks, the version first. The same text travels on the Zenoh pulse
session and in `frame_id` of the std_msgs/Header beats of DDS transports. Unknown versions and garbage raise BeatError
with a reason to count by; they never reach the machines. Times are microseconds of the sender's steady clock unless
stated otherwise; durations are microseconds, ages in a report are milliseconds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from robot_offload_core.fence.token import Site, Token, is_incarnation
from robot_offload_core.words.replace import replace
from robot_offload_core.words.veil import unveiled, veiled

VERSION = "4"
PREVIOUS = "3"
"""Also read, and sent to a peer that sends it: without `shape`, and with the robot's incarnation unhashed."""
SHAPE_LENGTH = 8
"""Hexadecimal digits of a shape."""
MAX_LENGTH = 900
"""Longest text accepted: one datagram of the smallest assumed path MTU (1150 bytes less the transport's own)."""
NONE = "-"
MAX_AGE_MS = 99_999
"""Longest age in a report, ms: anything older is too old anyway. Keeps the text short."""
MAX_INTEGER = 2**63
MAX_BITS = 256
"""Most outputs that have a bit in a report."""
HEXADECIMAL = frozenset("0123456789abcdef")
GRANT_CANDIDATE, GRANT_IN_CHARGE, GRANT_PRESENCE = 1, 2, 3
UID_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-")
MAX_UID = 63


class BeatError(ValueError):
    """The text is not a valid beat. `reason` is BadVersion or BadForm."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(f"{reason}: {message}")
        self.reason = reason


@dataclass(frozen=True)
class Echo:
    """Proof of having heard the newest beat of the other side.

    Attributes:
        incarnation: of the sender of that beat.
        sequence: of that beat.
        sent_us: as written in that beat, on its sender's clock.
        hold_us: time from its arrival to the sending of this echo.
    """

    incarnation: str
    sequence: int
    sent_us: int
    hold_us: int


@dataclass(frozen=True)
class Permission:
    """The robot's part of a beat: what its control process allows.

    Attributes:
        epoch: of the side in charge, or the candidate while the cloud is prepared.
        granted: the cloud named in `cloud` may act under (robot, epoch, cloud).
        cloud: incarnation of the cloud's control process that this is addressed to; "" before one was heard.
        lease_us: length of the grant.
        in_charge: the cloud is in charge under this epoch; False while it only gets ready.
        presence: nodes with placement Cloud may publish under the presence token, whichever side is in charge.

    On the wire the grant has four values: 0 none, 1 to get ready, 2 in charge, 3 presence alone. Grants 1 and 2 include
    presence.
    """

    epoch: int
    granted: bool
    cloud: str
    lease_us: int
    in_charge: bool = False
    presence: bool = False

    def token(self, robot: str) -> Token:
        """Return the token that a grant names."""
        return Token(robot, self.epoch, self.cloud)


@dataclass(frozen=True)
class CloudReport:
    """The cloud's part of a beat: the report of its control process.

    Attributes:
        serves: incarnation of the robot that the cloud serves; "" for none.
        epoch: under which the cloud acts or gets ready; 0 for none.
        acting: the cloud holds a lease of that epoch and its nodes are ready.
        ready: all its duplicated CORE nodes are Active.
        refused: incarnation of a second robot that it refuses; "" for none.
        data_age_us: time since its data session last heard the robot; -1 never.
        input_ages_us: newest accepted age of each required input, in the order of the configuration; -1 never.
        rated: one bit per output, 1 << its place in the configuration, set if the output's `while` is true there.
        shape: digest of everything numbered by its place in the cloud's configuration; "" from an older cloud.
    """

    serves: str = ""
    epoch: int = 0
    acting: bool = False
    ready: bool = False
    refused: str = ""
    data_age_us: int = -1
    input_ages_us: tuple[int, ...] = ()
    rated: int = 0
    shape: str = ""


@dataclass(frozen=True)
class Beat:
    """One beat.

    Attributes:
        uid: of the RobotOffload; foreign ones are ignored.
        sender: the side that sent it.
        incarnation: of the sender's control process; "" while control is not up.
        sequence: grows by one with every beat of one pulse process.
        sent_us: when it was sent.
        wall_us: the sender's system clock minus its steady clock, for the estimate of the clock offset.
        control_age_us: time since control last sent to this pulse process; -1 never.
        echo: of the beat heard last; None if none was.
        body: Permission from the robot, CloudReport from the cloud; None if control has fallen silent.
        version: of the text form.
    """

    uid: str
    sender: Site
    incarnation: str
    sequence: int
    sent_us: int
    wall_us: int
    control_age_us: int
    echo: Echo | None
    body: Permission | CloudReport | None
    version: str = VERSION


def veil(beat: Beat) -> Beat:
    """Return a beat of the cloud as it is sent: with hashes for the robots that it serves, echoes and refuses."""
    echo, body = beat.echo, beat.body
    if echo is not None:
        echo = replace(echo, incarnation=veiled(echo.incarnation))
    if isinstance(body, CloudReport):
        body = replace(body, serves=veiled(body.serves), refused=veiled(body.refused))
    return replace(beat, echo=echo, body=body)


def unveil(beat: Beat, own: str) -> Beat:
    """Return a beat of the cloud with the hash of `own`, the receiving robot's incarnation, replaced by `own`."""
    echo, body = beat.echo, beat.body
    if echo is not None:
        echo = replace(echo, incarnation=unveiled(echo.incarnation, own))
    if isinstance(body, CloudReport):
        body = replace(body, serves=unveiled(body.serves, own), refused=unveiled(body.refused, own))
    return replace(beat, echo=echo, body=body)


def encode(beat: Beat) -> str:
    """Encode a beat as text; raise BeatError if decoding would not return the same beat."""
    echo = beat.echo
    words = [
        beat.version,
        beat.uid,
        "r" if beat.sender is Site.ROBOT else "c",
        beat.incarnation or NONE,
        str(beat.sequence),
        str(beat.sent_us),
        str(beat.wall_us),
        str(beat.control_age_us),
        *((echo.incarnation, str(echo.sequence), str(echo.sent_us), str(echo.hold_us)) if echo else (NONE,) * 4),
    ]
    body = beat.body
    if isinstance(body, Permission):
        words += [
            str(body.epoch),
            str(_grant(body)),
            body.cloud or NONE,
            str(body.lease_us),
        ]
    elif isinstance(body, CloudReport):
        words += [
            body.serves or NONE,
            str(body.epoch),
            str(int(body.acting)),
            str(int(body.ready)),
            body.refused or NONE,
            _age(body.data_age_us),
            ",".join(map(_age, body.input_ages_us)) or NONE,
            f"{body.rated:x}",
            *((body.shape or NONE,) if beat.version != PREVIOUS else ()),
        ]
    text = " ".join(words)
    if len(text) > MAX_LENGTH:
        raise BeatError("BadForm", f"{len(text)} characters are more than {MAX_LENGTH}; declare fewer rated inputs")
    return text


def _grant(body: Permission) -> int:
    """Return the value of a grant on the wire."""
    if body.granted:
        return GRANT_IN_CHARGE if body.in_charge else GRANT_CANDIDATE
    return GRANT_PRESENCE if body.presence else 0


def encode_fitting(beat: Beat) -> str:
    """Encode a beat; if the text is too long, encode it without a body, so that it renews nothing."""
    try:
        return encode(beat)
    except BeatError:
        return encode(replace(beat, body=None))


def _age(age_us: int) -> str:
    """Return the text of an age: whole milliseconds, rounded up, at most MAX_AGE_MS; -1 never."""
    return "-1" if age_us < 0 else str(min(MAX_AGE_MS, -(-age_us // 1000)))


class _Words:
    """Reads typed words one after the other."""

    def __init__(self, words: list[str]) -> None:
        self.rest = words

    def word(self) -> str:
        if not self.rest:
            raise BeatError("BadForm", "too short")
        return self.rest.pop(0)

    def integer(self, low: int = 0) -> int:
        text = self.word()
        digits = text[1:] if text.startswith("-") else text
        if not (digits.isascii() and digits.isdigit() and len(digits) < 20):
            raise BeatError("BadForm", f"{text[:20]!r} is no integer")
        value = int(text)
        if not low <= value < MAX_INTEGER:
            raise BeatError("BadForm", f"{value} is out of range")
        return value

    def flag(self) -> bool:
        return bool(self.integer())

    def incarnation(self) -> str:
        text = self.word()
        if text == NONE:
            return ""
        if not is_incarnation(text):
            raise BeatError("BadForm", "an incarnation has 32 hexadecimal digits")
        return text


_ONE, _MANY = r"(-|[0-9a-f]{32})", r"(-1|[0-9]{1,18})"
_USUAL = re.compile(
    rf"[{PREVIOUS}{VERSION}] ([A-Za-z0-9._-]{{1,{MAX_UID}}}) (?:r|(c)) {_ONE} ([0-9]{{1,18}}) ([0-9]{{1,18}}) "
    rf"(-?[0-9]{{1,18}}) {_MANY} "
    r"([0-9a-f]{32}) ([0-9]{1,18}) ([0-9]{1,18}) ([0-9]{1,18}) (?:"
    rf"([0-9]{{1,18}}) ([0-3]) {_ONE} ([0-9]{{1,18}})|"
    rf"{_ONE} ([0-9]{{1,18}}) ([01]) ([01]) {_ONE} {_MANY} (-|{_MANY}(?:,{_MANY})*) ([0-9a-f]{{1,{MAX_BITS // 4}}})"
    rf"(?: (-|[0-9a-f]{{{SHAPE_LENGTH}}}))?)"
)
"""A whole beat with an echo; any other form is read word by word."""


def decode(text: str) -> Beat:
    """Decode a beat; raise BeatError for anything else."""
    if len(text) > MAX_LENGTH:
        raise BeatError("BadForm", "too long")
    usual = _USUAL.fullmatch(text)
    if usual is not None and (usual[2] is None) is (usual[12] is not None):
        shaped = text[0] == VERSION and usual[2] is not None
        if shaped is (usual.groups()[-1] is not None):
            return _usual(text[0], usual.groups())
    return _word_by_word(text)


def _usual(version: str, found: tuple[str, ...]) -> Beat:
    """Return the beat of a match, in less than half the time of reading it word by word."""
    uid, cloud, incarnation, sequence, sent_us, wall_us, control_us, echoed, echo_number, echo_us, hold_us = found[:11]
    body: Permission | CloudReport
    if cloud is None:
        epoch, grant, addressed, lease_us = found[11:15]
        granted = grant in "12"
        addressed = "" if addressed == NONE else addressed
        body = Permission(int(epoch), granted, addressed, int(lease_us), grant == "2", presence=grant != "0")
    else:
        serves, epoch, acting, ready, refused, data_ms, ages = found[15:22]
        body = CloudReport(
            "" if serves == NONE else serves, int(epoch), acting == "1", ready == "1",
            "" if refused == NONE else refused, _milliseconds(data_ms),
            () if ages == NONE else tuple(map(_milliseconds, ages.split(","))), int(found[-2], 16),
            "" if found[-1] in (None, NONE) else found[-1],
        )  # fmt: skip
    return Beat(
        uid, Site.ROBOT if cloud is None else Site.CLOUD, "" if incarnation == NONE else incarnation, int(sequence),
        int(sent_us), int(wall_us), int(control_us), Echo(echoed, int(echo_number), int(echo_us), int(hold_us)), body,
        version,
    )  # fmt: skip


def _milliseconds(text: str) -> int:
    return -1 if text == "-1" else int(text) * 1000


def _word_by_word(text: str) -> Beat:
    words = _Words(text.split(" "))
    version = words.word()
    if version not in (VERSION, PREVIOUS):
        raise BeatError("BadVersion", f"version {version[:20]!r}, this side speaks {VERSION} and {PREVIOUS}")
    uid = words.word()
    if not uid or len(uid) > MAX_UID or not UID_CHARACTERS.issuperset(uid):
        raise BeatError("BadForm", "bad uid")
    side = words.word()
    if side not in ("r", "c"):
        raise BeatError("BadForm", "the side is r or c")
    sender = Site.ROBOT if side == "r" else Site.CLOUD
    incarnation, sequence, sent_us = words.incarnation(), words.integer(), words.integer()
    wall_us, control_age_us = words.integer(-MAX_INTEGER), words.integer(-1)
    echo = _echo(words)
    body: Permission | CloudReport | None = None
    if words.rest:
        body = _permission(words) if sender is Site.ROBOT else _report(words, version)
    if words.rest:
        raise BeatError("BadForm", "too long")
    return Beat(uid, sender, incarnation, sequence, sent_us, wall_us, control_age_us, echo, body, version)


def _age_us(words: _Words) -> int:
    age_ms = words.integer(-1)
    return -1 if age_ms < 0 else age_ms * 1000


def _echo(words: _Words) -> Echo | None:
    incarnation = words.incarnation()
    if not incarnation:
        if [words.word() for _ in range(3)] != 3 * [NONE]:
            raise BeatError("BadForm", "an echo of nobody")
        return None
    return Echo(incarnation, words.integer(), words.integer(), words.integer())


def _permission(words: _Words) -> Permission:
    epoch, grant = words.integer(), words.integer()
    if grant > GRANT_PRESENCE:
        raise BeatError("BadForm", f"{grant} is no grant")
    granted = grant in (GRANT_CANDIDATE, GRANT_IN_CHARGE)
    cloud, lease_us = words.incarnation(), words.integer()
    return Permission(epoch, granted, cloud, lease_us, grant == GRANT_IN_CHARGE, presence=grant > 0)


def _report(words: _Words, version: str) -> CloudReport:
    serves, epoch, acting, ready = words.incarnation(), words.integer(), words.flag(), words.flag()
    refused, data_age_us, ages = words.incarnation(), _age_us(words), words.word()
    listed = _Words([] if ages == NONE else ages.split(","))
    input_ages_us = []
    while listed.rest:
        input_ages_us.append(_age_us(listed))
    bits, shape = _bits(words.word()), "" if version == PREVIOUS else _shape(words.word())
    return CloudReport(serves, epoch, acting, ready, refused, data_age_us, tuple(input_ages_us), bits, shape)


def _shape(text: str) -> str:
    if text != NONE and (len(text) != SHAPE_LENGTH or not HEXADECIMAL.issuperset(text)):
        raise BeatError("BadForm", f"{text[:20]!r} is not a shape")
    return "" if text == NONE else text


def _bits(text: str) -> int:
    if not 0 < len(text) <= MAX_BITS // 4 or not HEXADECIMAL.issuperset(text):
        raise BeatError("BadForm", f"{text[:20]!r} are no bits of outputs")
    return int(text, 16)


PERMISSION_BEATS = 2
"""Beats for which a permission of control is valid (protocol section 1)."""
