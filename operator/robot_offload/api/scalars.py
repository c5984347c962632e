"""Plain YAML scalars as kubectl reads them, and which of them people take for something else.

kubectl reads YAML 1.1 (sigs.k8s.io/yaml over go.yaml.in/yaml/v2, whose `resolve` is followed here), most editors and
people YAML 1.2. What the two read differently is refused, so that a file says the same to everybody: `y`, `0777`.
"""

from __future__ import annotations

import math
import re
from typing import Final, TypeAlias

Scalar: TypeAlias = bool | int | float | str | None

_NULLS: Final = ("", "~", "null", "Null", "NULL")
_WORDS: Final[dict[str, bool]] = {
    spelled: truth
    for truth, words in ((True, ("y", "yes", "on", "true")), (False, ("n", "no", "off", "false")))
    for word in words
    for spelled in (word, word.capitalize(), word.upper())
}
_TRUTH: Final = tuple(spelled for spelled in _WORDS if spelled.lower() in ("true", "false"))
_ENDLESS: Final = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_INTEGER_11: Final = re.compile(
    r"[-+]?(?:0[xX](?P<hex>[0-9a-fA-F]+)|0[bB](?P<binary>[01]+)|0[oO]?(?P<octal>[0-7]+)|(?P<decimal>0|[1-9][0-9]*))"
)
_BASES: Final = {"hex": 16, "binary": 2, "octal": 8, "decimal": 10}
_FLOAT: Final = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INTEGER_12: Final = re.compile(r"0x[0-9a-fA-F]+|0o[0-7]+|[-+]?[0-9]+")
_NUMERIC: Final = re.compile(r"[-+.0-9][-+._0-9a-fA-FxXoO]*")
_LONGEST: Final = 80
"""Characters of a number that anybody writes; 64 binary digits fit."""
_LEAST, _MOST = -(2**63), 2**63 - 1


class ScalarError(ValueError):
    """A plain scalar that is not read the same by everybody; the message says what to write."""


def read(text: str) -> Scalar:
    """Return the value of a plain scalar.

    Raises:
        ScalarError: YAML 1.1 and YAML 1.2 differ about it, or JSON cannot carry it.
    """
    if len(text) > _LONGEST and _NUMERIC.fullmatch(text):
        raise ScalarError(f"a number of {len(text)} characters does not fit into 64 bits; write it in quotes for text")
    value = by_kubectl(text)
    if isinstance(value, float) and not math.isfinite(value):
        raise ScalarError(f"{text} cannot be sent to a cluster, because JSON has finite numbers only; leave it out")
    if isinstance(value, int) and not isinstance(value, bool) and not _LEAST <= value <= _MOST:
        raise ScalarError(f"{text} does not fit into 64 bits; write a smaller number, or '{text}' in quotes for text")
    other = _by_yaml_12(text)
    if type(value) is type(other) and value == other:
        return value
    raise ScalarError(_advice(text, value))


def read_key(text: str) -> str:
    """Return a plain key, which is text for kubectl as well.

    Raises:
        ScalarError: kubectl makes another key of it.
    """
    if len(text) > _LONGEST and _NUMERIC.fullmatch(text):
        raise ScalarError("write this key in quotes: kubectl reads it as a number")
    value = by_kubectl(text)
    if isinstance(value, str) or (isinstance(value, bool | int) and _json(value) == text and _LEAST <= value <= _MOST):
        return text
    raise ScalarError(f"write '{text}' in quotes: kubectl reads this key as {_json(value)}")


def by_kubectl(text: str) -> Scalar:
    """Return what kubectl makes of a plain scalar; numbers may be larger than JSON readers take."""
    if text in _NULLS:
        return None
    if text in _WORDS:
        return _WORDS[text]
    if _ENDLESS.fullmatch(text):
        return float(text.lower().replace(".", ""))
    if not re.match(r"[-+.0-9]", text):
        return text
    plain = text.replace("_", "")
    if integer := _INTEGER_11.fullmatch(plain):
        base = str(integer.lastgroup)
        return int(integer[base], _BASES[base]) * (-1 if plain.startswith("-") else 1)
    if _FLOAT.fullmatch(plain) and math.isfinite(float(plain)):
        return float(plain)
    return text


def _by_yaml_12(text: str) -> Scalar:
    """Return what the core schema of YAML 1.2 makes of a plain scalar."""
    if text in _NULLS:
        return None
    if text in _TRUTH:
        return _WORDS[text]
    if _INTEGER_12.fullmatch(text):
        return int(text, 0) if text[:2] in ("0x", "0o") else int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def _advice(text: str, value: Scalar) -> str:
    otherwise = ""
    if isinstance(value, bool):
        otherwise = f", or {_json(value)}"
    elif isinstance(value, int | float):
        otherwise = f", or the number as {_json(value)}"
    found = "text" if isinstance(value, str) else _json(value)
    return f"write '{text}' in quotes{otherwise}: kubectl reads {text} as {found}"


def _json(value: Scalar) -> str:
    """Return the value as kubectl sends it."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, float) and value.is_integer() else str(value)
