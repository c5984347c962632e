"""From command line options to a specification, as the features declare them. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias, TypeVar

from robot_offload.errors import InputError, SpecError
from robot_offload.findings import Finding
from robot_offload.images.features import NODE_FEATURES, OVERLAY_FEATURES, Flag
from robot_offload.images.spec import BuildSpec, OverlaySpec, parse

Given: TypeAlias = Mapping[str, Any]
"""Values by option; those not given are None, False or empty."""


SomeSpec = TypeVar("SomeSpec", BuildSpec, OverlaySpec)


def _unique(flags: Iterable[Flag]) -> tuple[Flag, ...]:
    return tuple({flag.option: flag for flag in flags}.values())


NODE_FLAGS: Final = _unique(flag for feature in NODE_FEATURES for flag in feature.flags)
OVERLAY_FLAGS: Final = _unique(flag for feature in OVERLAY_FEATURES for flag in feature.flags)
ALL_FLAGS: Final = _unique((*NODE_FLAGS, *OVERLAY_FLAGS))


def node_spec(given: Given, block: Mapping[str, Any], source: str) -> BuildSpec:
    """Build the specification of a node's image from a `build:` block and the options, which override it.

    Args:
        given: the options.
        block: a block in YAML form; empty: none.
        source: the block's name in messages.

    Raises:
        InputError: an option belongs to an image with the agent, or a value cannot be used.
    """
    _refuse(given, NODE_FLAGS, "goes with --agent only")
    return _parsed(BuildSpec, NODE_FLAGS, given, block, source)


def overlay_spec(given: Given, agent_image: str) -> OverlaySpec:
    """Build the specification of an image with the agent.

    Args:
        given: the options.
        agent_image: the agent's image, if no option names one.

    Raises:
        InputError: an option belongs to a node's image, or a value cannot be used.
    """
    _refuse(given, OVERLAY_FLAGS, "does not go with --agent")
    return _parsed(OverlaySpec, OVERLAY_FLAGS, given, {"agentImage": agent_image}, "options")


def option_findings(findings: Sequence[Finding], given: Given) -> list[Finding]:
    """Return the findings with the option instead of the field, if the option was given."""
    return [_told_as_option(finding, given) for finding in findings]


def _told_as_option(finding: Finding, given: Given) -> Finding:
    for flag in ALL_FLAGS:
        field = re.escape(flag.field)
        if given.get(flag.option) and re.match(rf"{field}($|[.\[])", finding.path):
            return Finding(flag.option, finding.reason, finding.message, finding.severity)
    return finding


def _refuse(given: Given, known: Sequence[Flag], words: str) -> None:
    options = {flag.option for flag in known}
    for option, value in given.items():
        if value and option not in options:
            raise InputError(f"{option}: {words}")


def _parsed(
    model: type[SomeSpec], flags: Sequence[Flag], given: Given, block: Mapping[str, Any], source: str
) -> SomeSpec:
    values: dict[str, Any] = {}
    for flag in flags:
        value = given.get(flag.option)
        if value not in (None, False, (), []):
            _put(values, flag.field.split("."), _split(flag, value))
    try:
        return parse(model, _laid_over(block, values), source)
    except SpecError as error:
        raise SpecError(error.source, option_findings(error.findings, given)) from error


def _put(values: dict[str, Any], path: Sequence[str], value: Any) -> None:
    for part in path[:-1]:
        values = values.setdefault(part, {})
    values[path[-1]] = value


def _split(flag: Flag, value: Any) -> Any:
    """Split variables and labels given as NAME=VALUE; return other values as they are."""
    if flag.metavar != "NAME=VALUE":
        return value
    pairs = []
    for text in value:
        name, sign, rest = text.partition("=")
        if not sign:
            raise InputError(f"{flag.option}: {text[:40]!r} has no equals sign; write NAME=VALUE")
        pairs.append((name, rest))
    return dict(pairs) if flag.field == "labels" else [{"name": name, "value": rest} for name, rest in pairs]


def _laid_over(block: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `block` overridden by `values`; mappings are merged, everything else is replaced."""
    result = dict(block)
    for key, value in values.items():
        both = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _laid_over(result[key], value) if both else value
    return result
