"""Settings that change at run time: which ones may, and whether the robot takes the cloud's offer. Pure.

The robot's own file holds the hard limits: an offer may be stricter, never looser. The reasons for each choice
are in docs/reference/agent-files.md.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings.parameters import (
    GENERAL,
    GROUPS,
    Configuration,
    block,
    check,
    document,
    flatten,
    listed,
    parse,
)
from robot_offload_agent.settings.topics import INPUT
from robot_offload_core.words.reasons import Explained

RUN_TIME = (
    "generation", "mode", "pin", "prefer", "loss_timeout_ms", "lease_ms", "max_command_age_ms", "robot_period_ms",
    "cloud_period_ms", "tolerance_ms", "min_dwell_ms", "hold_down_initial_ms", "hold_down_max_ms", "flap_window_ms",
    "activation_deadline_ms", "max_clock_offset_ms",
)  # fmt: skip
"""What may change while the agents run."""
RUN_TIME_INPUT = ("max_age_ms", "max_rate_hz")
"""The same for each input that the robot's file declares."""
HARD_LIMITS = (
    "loss_timeout_ms", "lease_ms", "max_command_age_ms", "activation_deadline_ms", "max_clock_offset_ms",
)  # fmt: skip
"""Never above the value in the robot's file."""
MAX_AUTHOR = 256
"""Most characters: a field manager has 128 at most."""
MEMBER = re.compile(rf"({'|'.join(prefix for prefix, _ in GROUPS.values())})\.(.+)\.([a-z_]+)")


@dataclass(frozen=True)
class Offer:
    """Settings that the cloud offers: the parameters of one generation of the resource, by dotted name.

    `author` is who changed the resource last, as the operator reports it, for the audit trail; it is not part of the
    offer.
    """

    generation: int
    parameters: Mapping[str, Any]
    author: str = ""

    @property
    def digest(self) -> str:
        """Name of exactly these settings in an answer: 16 hexadecimal digits."""
        text = json.dumps([self.generation, dict(self.parameters)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


class Answer(Explained):
    """The robot's answer to settings that the cloud offers."""

    ACCEPTED = "Accepted", "The robot runs these settings"
    OLDER_GENERATION = (
        "OlderGeneration", "The settings are older than those that the robot runs", "Make a new bundle if that is meant"
    )  # fmt: skip
    UNKNOWN_PARAMETER = "UnknownParameter", "The robot's agent is too old for a parameter", "Update the robot's agent"
    INVALID = "Invalid", "A value is outside its range", "Change the value"
    NEEDS_BUNDLE = "NeedsBundle", "A value cannot change while the robot runs", "Make a new bundle for the robot"
    HARD_LIMIT = (
        "HardLimit", "A value is looser than the robot's own file allows", "Make a new bundle, or a stricter value"
    )  # fmt: skip
    INCONSISTENT = "Inconsistent", "Values are good by themselves and cannot work together", "Read the message"
    KEEPING = "Keeping", "The robot writes the settings to its disk and answers after that"
    NOT_KEPT = "NotKept", "The robot's disk does not take the settings", "Free the disk, or set `state_dir`"


@dataclass(frozen=True)
class Judgement:
    """Whether an offer is taken, and why (not).

    Attributes:
        configuration: the robot's file with the offer in it; None: refused.
        reason: see Answer.
        message: for people.
    """

    configuration: Configuration | None
    reason: Answer
    message: str


def read_offer(text: str) -> Offer:
    """Return the settings file of the cloud's agent; raise ConfigurationError."""
    found = document(text, "settings_file")
    parameters = flatten(block(found, "settings_file"))
    generation = parameters.pop("generation", 0)
    try:
        checked = check(GENERAL["generation"], generation)
        json.dumps(parameters)
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f"settings_file: {error}") from error
    assert isinstance(checked, int)
    return Offer(checked, parameters, author_of(found.get("changed_by")))


def author_of(value: object) -> str:
    """Return who changed the settings, as another program wrote it: one line, or nothing."""
    return value[:MAX_AUTHOR] if isinstance(value, str) and value.isascii() and value.isprintable() else ""


def judge(local: Configuration, running: int, offer: Offer) -> Judgement:
    """Judge an offer by the robot's own file; `running` is the generation that runs now."""
    if offer.generation < max(running, local["generation"]):
        message = (
            f"Generation {offer.generation} is older than {max(running, local['generation'])}, which the robot runs; "
            "make a new bundle when that is meant"
        )
        return Judgement(None, Answer.OLDER_GENERATION, message)
    for reason, findings in (
        (Answer.UNKNOWN_PARAMETER, _unknown(offer)),
        (Answer.INVALID, _invalid(offer)),
        (Answer.NEEDS_BUNDLE, _fixed(local, offer)),
        (Answer.HARD_LIMIT, _loosened(local, offer)),
    ):
        problems = list(findings)  # not all beforehand: the later questions make sense for what has passed the earlier
        if problems:
            return Judgement(None, reason, "; ".join(problems))
    try:
        configuration = parse({**local.values, **offer.parameters, "generation": offer.generation})
    except ConfigurationError as error:
        return Judgement(None, Answer.INCONSISTENT, "; ".join(str(error).splitlines()))
    return Judgement(configuration, Answer.ACCEPTED, f"The robot runs generation {offer.generation}")


def input_limits(configuration: Configuration) -> tuple[tuple[str, float, float], ...]:
    """Return (input, max_age_ms, max_rate_hz) of every input."""
    return tuple((i.name, i["max_age_ms"], i["max_rate_hz"]) for i in configuration.inputs)


def offered_limits(configuration: Configuration, offer: Offer | None) -> tuple[tuple[str, float, float], ...]:
    """Return the same with the values of an offer; only for offers that the robot has taken."""
    told = offer.parameters if offer is not None else {}
    return tuple(
        (
            i.name,
            float(told.get(f"input.{i.name}.max_age_ms", i["max_age_ms"])),
            float(told.get(f"input.{i.name}.max_rate_hz", i["max_rate_hz"])),
        )
        for i in configuration.inputs
    )


def _member(name: str) -> tuple[str, str] | None:
    """Return (prefix, key) of a parameter of a node, an output or an input."""
    found = MEMBER.fullmatch(name)
    tables = dict(GROUPS.values())
    if found is None or found[3] not in tables[found[1]]:
        return None
    return found[1], found[3]


def _unknown(offer: Offer) -> Iterator[str]:
    for name in offer.parameters:
        if name not in GENERAL and _member(name) is None:
            yield f"parameter {name}: unknown to this robot's agent"


def _invalid(offer: Offer) -> Iterator[str]:
    tables = dict(GROUPS.values())
    for name, value in offer.parameters.items():
        member = _member(name)
        parameter = GENERAL[name] if member is None else tables[member[0]][member[1]]
        try:
            check(parameter, value)
        except ValueError as error:
            yield f"parameter {name}: {error}"


def _fixed(local: Configuration, offer: Offer) -> Iterator[str]:
    """Yield the parameters that an offer changes although they cannot change at run time."""
    for name, value in offer.parameters.items():
        member = _member(name)
        known = local.values.get(name)
        if known is None and member is not None:
            yield f"parameter {name}: {member[0]} is not in the robot's file"
        elif name in RUN_TIME:
            continue
        elif member is not None and member[0] == "input" and member[1] in RUN_TIME_INPUT:
            if member[1] == "max_age_ms" and bool(known) is not bool(value):
                yield f"parameter {name}: a limit can be changed at run time, not begun or ended"
        elif _plain(known) != _plain(value):
            yield f"parameter {name}: {_plain(value)} here, {_plain(known)} in the robot's file"


def _plain(value: Any) -> Any:
    return listed(value) if isinstance(value, list) else value


def _loosened(local: Configuration, offer: Offer) -> Iterator[str]:
    for name, value in offer.parameters.items():
        member = _member(name)
        if name not in HARD_LIMITS and member != ("input", "max_age_ms"):
            continue
        if value > local[name]:
            yield f"parameter {name}: {value:g} is above the robot's own limit of {local[name]:g}"


assert set(RUN_TIME) <= GENERAL.keys()
assert set(RUN_TIME_INPUT) <= INPUT.keys()
