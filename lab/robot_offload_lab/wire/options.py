"""The configuration of the emulated link: option texts as a person types them, and the process's file."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from robot_offload_lab.links.recorded import TraceError, load_trace
from robot_offload_lab.wire.model import LinkConditions, WireError
from robot_offload_lab.wire.schedule import Constant, Replay, Schedule, SchedulePart, outage, slow_phase

Protocol = Literal["udp", "tcp"]

DEFAULT_QUEUE_MS = 150.0
"""Default queue in front of a rate-limited link: typical of home routers."""

_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"
_MS_PER_UNIT = {"ms": 1.0, "s": 1000.0}
_KBIT_PER_UNIT = {"kbit": 1.0, "mbit": 1000.0, "gbit": 1_000_000.0}


class OptionError(WireError):
    """An option that cannot be understood; the message names it and shows the right form."""


def parse_ms(option: str, text: str) -> float:
    """Return a time with its unit, in milliseconds.

    Raises:
        OptionError: the text is not a number with `ms` or `s`.
    """
    match = re.fullmatch(rf"{_NUMBER}\s*(ms|s)", text.strip())
    if not match:
        raise OptionError(
            f"{option}: {text!r} is not a valid time; write a number with its unit, for example 10ms or 0.5s"
        )
    return float(match[1]) * _MS_PER_UNIT[match[2]]


def parse_loss(option: str, text: str) -> float:
    """Return a share of packets, `3%` or `0.03`, from 0 to 1.

    Raises:
        OptionError: the text is not a share from 0 to 1.
    """
    match = re.fullmatch(rf"{_NUMBER}\s*(%?)", text.strip())
    share = float(match[1]) / (100 if match[2] else 1) if match else -1.0
    if not 0 <= share <= 1:
        raise OptionError(f"{option}: {text!r} is not a valid share of packets; write for example 3% or 0.03")
    return share


def parse_rate(option: str, text: str) -> float:
    """Return a rate such as `20mbit` or `512kbit` (also with `/s`), in kbit/s.

    Raises:
        OptionError: the text is not a rate above 0.
    """
    match = re.fullmatch(rf"{_NUMBER}\s*([kmg]bit)(/s)?", text.strip().lower())
    rate_kbit_s = float(match[1]) * _KBIT_PER_UNIT[match[2]] if match else 0.0
    if rate_kbit_s <= 0:
        raise OptionError(f"{option}: {text!r} is not a valid rate; write for example 20mbit or 512kbit")
    return rate_kbit_s


def parse_outage(option: str, text: str) -> SchedulePart:
    """Return `4/20`: both directions cut for 4 s out of every 20 s.

    Raises:
        OptionError: not of that form, or longer than its period.
    """
    return outage(*_parse_phase(option, text, example="4/20 (4 s out of every 20 s)"))


def parse_slow(option: str, text: str) -> SchedulePart:
    """Return `3/45@120ms`: 120 ms more of round trip for 3 s out of every 45 s.

    Raises:
        OptionError: not of that form, or longer than its period.
    """
    example = "3/45@120ms (120 ms more of round trip, for 3 s out of every 45 s)"
    phase, at, extra = text.partition("@")
    if not at:
        raise OptionError(f"{option}: {text!r} does not say how much slower; write for example {example}")
    length_s, period_s = _parse_phase(option, phase, example)
    return slow_phase(length_s, period_s, parse_ms(option, extra))


def _parse_phase(option: str, text: str, example: str) -> tuple[float, float]:
    match = re.fullmatch(rf"{_NUMBER}s?\s*/\s*{_NUMBER}s?", text.strip())
    if not match:
        raise OptionError(f"{option}: {text!r} is not a valid phase; write for example {example}")
    length_s, period_s = float(match[1]), float(match[2])
    if not 0 < length_s < period_s:
        raise OptionError(
            f"{option}: {text!r}: a phase must be longer than 0 s and shorter than its period; "
            f"write for example {example}"
        )
    return length_s, period_s


@dataclass(frozen=True)
class LinkOptions:
    """The link as the user describes it. A text with one value applies to both directions; `UP/DOWN` has one for each.

    Attributes:
        delay: one-way delay, `10ms` or `10ms/30ms`.
        jitter: standard deviation of the one-way delay.
        loss: share of packets lost in each direction, `3%`.
        rate: `20mbit`.
        queue: tail-drop queue in front of a limited rate, as a time.
        reorder: datagrams may overtake each other by jitter.
        outages: `4/20` each.
        slow: `3/45@120ms` each.
        trace: file to replay.
    """

    delay: str = "0ms"
    jitter: str = "0ms"
    loss: str = "0%"
    rate: str = ""
    queue: str = ""
    reorder: bool = False
    outages: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()
    trace: str = ""

    @classmethod
    def from_dict(cls, raw: Any) -> LinkOptions:
        """Read what `dataclasses.asdict` made, also after it went through JSON.

        Raises:
            WireError: an unknown key or a value of the wrong type.
        """
        values = _object(raw, cls, "link")
        for name in ("outages", "slow"):
            values[name] = tuple(_list(values.get(name, [])))
        return cls(**values)

    def schedule(self) -> Schedule:
        """Understand the texts and read the trace.

        Raises:
            OptionError: names the option and shows the right form.
        """
        delays, jitters = _pair("--delay", self.delay, parse_ms), _pair("--jitter", self.jitter, parse_ms)
        losses = _pair("--loss", self.loss, parse_loss)
        rates = _pair("--rate", self.rate, parse_rate) if self.rate else (0.0, 0.0)
        if self.queue and not self.rate:
            raise OptionError("--queue: there is no queue without a limited rate; add for example --rate 20mbit")
        queues = _pair("--queue", self.queue, parse_ms) if self.queue else (DEFAULT_QUEUE_MS, DEFAULT_QUEUE_MS)
        up, down = (
            LinkConditions(delay, jitter, loss, rate, queue if rate else 0.0, self.reorder)
            for delay, jitter, loss, rate, queue in zip(delays, jitters, losses, rates, queues, strict=True)
        )
        parts: list[SchedulePart] = [Constant(up, down)]
        parts += [parse_outage("--outage", text) for text in self.outages]
        parts += [parse_slow("--slow", text) for text in self.slow]
        if self.trace:
            try:
                parts.append(Replay(load_trace(Path(self.trace))))
            except TraceError as error:
                raise OptionError(f"--trace: {error}") from error
        return Schedule(tuple(parts))


def _pair(option: str, text: str, parse: Callable[[str, str], float]) -> tuple[float, float]:
    up, slash, down = text.partition("/")
    if slash and down.strip().lower() == "s":  # the one slash that is part of a unit: 20mbit/s
        up, slash = text, ""
    first = parse(option, up)
    return first, parse(option, down) if slash else first


@dataclass(frozen=True)
class Address:
    """Host and port of one end, written `host:port`, an IPv6 host in brackets."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Address:
        """Read `host:port`.

        Raises:
            WireError: not of that form.
        """
        host, _, port = text.rpartition(":")
        if not host or not port.isdecimal() or int(port) > 65535:
            raise WireError(f"{text!r} is not a valid address; write for example 127.0.0.1:7447")
        return cls(host.removeprefix("[").removesuffix("]"), int(port))

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


@dataclass(frozen=True)
class Forward:
    """One port of the wire.

    Attributes:
        name: unique, for logs and `Wire.port`.
        protocol: `udp` or `tcp`.
        listen: where the robot's side dials, `127.0.0.1:7447`; port 0 picks a free one.
        target: where the cloud's side listens.
    """

    name: str
    protocol: Protocol
    listen: str
    target: str

    def __post_init__(self) -> None:
        if self.protocol not in get_args(Protocol):
            raise WireError(f"forward {self.name!r}: protocol must be udp or tcp, found {self.protocol!r}")
        Address.parse(self.listen)
        Address.parse(self.target)


@dataclass(frozen=True)
class WireConfig:
    """Everything the wire's process needs.

    Attributes:
        forwards: the ports; all share one link.
        link: the link.
        seed: seed of all its random draws.
        control: path of the unix datagram socket; short, the kernel allows 107 bytes.
        log: path of the JSON-lines log; empty = none.
        realtime: ask for SCHED_FIFO; without the permission the process runs normally and logs that.
        start: start the schedule's clock at once instead of on `{"start": true}`.
    """

    forwards: tuple[Forward, ...]
    link: LinkOptions = LinkOptions()
    seed: int = 0
    control: str = ""
    log: str = ""
    realtime: bool = False
    start: bool = False

    def __post_init__(self) -> None:
        names = [forward.name for forward in self.forwards]
        if not names or len(set(names)) < len(names):
            raise WireError(f"a wire needs at least one forward, each with a name of its own, found {names}")

    def to_json(self) -> str:
        """Return the configuration file."""
        return json.dumps(dataclasses.asdict(self), indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str) -> WireConfig:
        """Read a configuration file.

        Raises:
            WireError: not JSON, an unknown or missing key, or a value out of range.
        """
        try:
            raw = json.loads(text)
        except json.JSONDecodeError as error:
            raise WireError(f"the wire's configuration is not JSON: {error}") from error
        fields = _object(raw, cls, "the configuration")
        fields["forwards"] = tuple(
            Forward(**_object(forward, Forward, "a forward")) for forward in _list(fields.get("forwards", []))
        )
        return cls(**{**fields, "link": LinkOptions.from_dict(fields.get("link", {}))})


def _object(raw: Any, cls: type, what: str) -> dict[str, Any]:
    """Return a JSON object that has only fields of `cls`, including all required ones, in the types of the defaults."""
    if not isinstance(raw, dict):
        raise WireError(f"{what} must be a JSON object, found {raw!r}")
    fields = {field.name: field for field in dataclasses.fields(cls)}
    for name in raw:
        if name not in fields:
            raise WireError(f"{what}: unknown key {name!r}; known are {', '.join(sorted(fields))}")
    for name, field in fields.items():
        required = field.default is dataclasses.MISSING
        if required and name not in raw:
            raise WireError(f"{what}: the key {name!r} is missing")
        simple = str if required else type(field.default)
        if name in raw and simple in (str, bool, int) and type(raw[name]) is not simple and name != "forwards":
            raise WireError(f"{what}: {name!r} must be of type {simple.__name__}, found {raw[name]!r}")
    return dict(raw)


def _list(raw: Any) -> Sequence[Any]:
    if not isinstance(raw, list):
        raise WireError(f"expected a JSON list, found {raw!r}")
    return raw
