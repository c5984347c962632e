"""Durations and sizes as text with a unit in YAML (`20ms`, `10m`; `8Mi`), as milliseconds and bytes in Python."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

# The subset of Go's durations (what Kubernetes writes) with whole milliseconds, the larger units first.
_PATTERN: Final = r"^([0-9]{1,6}h)?([0-9]{1,6}m)?([0-9]{1,6}s)?([0-9]{1,9}ms)?$"
_UNITS_MS: Final = {"h": 3_600_000, "m": 60_000, "s": 1_000, "ms": 1}


def parse_duration(text: object) -> int:
    """Return `text` (`20ms`, `90s`, `1m30s`) in milliseconds.

    Raises:
        ValueError: the message says how a duration is written.
    """
    match = re.fullmatch(_PATTERN, text) if isinstance(text, str) and text else None
    if match is None:
        raise ValueError(_complaint(text))
    parts = zip(match.groups(), _UNITS_MS.items(), strict=True)
    return sum(int(part.removesuffix(unit)) * factor for part, (unit, factor) in parts if part)


def _complaint(text: object) -> str:
    if isinstance(text, int | float) and not isinstance(text, bool):
        return f"is a duration and needs a unit: write {text:g}ms or {text:g}s"
    if isinstance(text, str) and re.fullmatch(r"[0-9]+\.[0-9]+(ms|s|m|h)", text):
        return f"{text!r} has a fraction; write whole numbers of a smaller unit, such as 1500ms for 1.5s"
    shown = repr(text)[:40] if isinstance(text, str) else "this"
    return f"{shown} is not a duration; write a whole number and a unit (ms, s, m or h), such as 20ms or 10m"


def format_duration(milliseconds: int) -> str:
    """Return `milliseconds` with the largest unit that divides it: 90000 -> `90s`, 150 -> `150ms`, 0 -> `0s`."""
    if milliseconds == 0:
        return "0s"
    unit, factor = next(item for item in _UNITS_MS.items() if milliseconds % item[1] == 0)
    return f"{milliseconds // factor}{unit}"


class _DurationType:
    """Tells pydantic how a duration is read, written and described."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            parse_duration,
            serialization=core_schema.plain_serializer_function_ser_schema(
                format_duration, return_schema=core_schema.str_schema()
            ),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"type": "string", "pattern": _PATTERN, "minLength": 2, "maxLength": 32}


@dataclass(frozen=True)
class Within:
    """Bounds of a duration, both allowed; given and shown as text.

    Attributes:
        minimum: the shortest duration.
        maximum: the longest duration.
        or_zero: whether 0s is allowed as well, as the word for "never".
    """

    minimum: str
    maximum: str
    or_zero: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        rule = f"duration(self) >= duration('{self.minimum}') && duration(self) <= duration('{self.maximum}')"
        if self.or_zero:
            rule = f"duration(self) == duration('0s') || ({rule})"
        described = handler(schema)
        described["x-kubernetes-validations"] = [{"rule": rule, "message": self._words}]
        return described

    @property
    def _words(self) -> str:
        return f"must be {'0s or ' if self.or_zero else ''}between {self.minimum} and {self.maximum}"

    def _check(self, value: int) -> int:
        inside = parse_duration(self.minimum) <= value <= parse_duration(self.maximum)
        if not inside and not (self.or_zero and value == 0):
            raise ValueError(f"{format_duration(value)} is out of range; it {self._words}")
        return value


Duration = Annotated[int, _DurationType()]
"""Whole milliseconds in Python, text with a unit in YAML. Combine it with `Within`."""

# The API server cuts a limit to a whole number where the value is one, so 0 would pass the minimum of 0.05.
_RATE_RULE: Final = {"rule": "self >= 0.05", "message": "must be at least 0.05"}
RateHz = Annotated[
    float,
    Field(ge=0.05, le=1000, allow_inf_nan=False, json_schema_extra={"x-kubernetes-validations": [_RATE_RULE]}),
]
"""Messages per second: from one in 20 s, which is slow for something that is judged, to the limit for control
loops."""

DomainID = Annotated[int, Field(ge=0, le=232)]
"""A DDS domain. 232 is the largest whose ports stay below 65536 (7400 + 250 * 232)."""

Port = Annotated[int, Field(ge=1, le=65535)]
"""A UDP and TCP port."""

_QUANTITY: Final = r"^[0-9]{1,12}(\.[0-9]{1,9})?(m|k|M|G|T|P|Ki|Mi|Gi|Ti|Pi)?$"

_NO_QUANTITY: Final = "is not a quantity; write for example 500m, 2, 512Mi or 4Gi"


def _check_quantity(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    if not isinstance(value, str) or not re.fullmatch(_QUANTITY, value):
        shown = repr(value)[:40] if isinstance(value, str | int | float) else "this"
        raise ValueError(f"{shown} {_NO_QUANTITY}")
    return value


Quantity = Annotated[
    str,
    BeforeValidator(_check_quantity),
    WithJsonSchema(
        {
            "anyOf": [{"type": "integer"}, {"type": "string"}],
            "pattern": _QUANTITY,
            "maxLength": 32,
            "x-kubernetes-int-or-string": True,
            "x-kubernetes-validations": [{"rule": "type(self) != int || self >= 0", "message": _NO_QUANTITY}],
        }
    ),
]
"""An amount of a resource as Kubernetes writes it: `500m` of a CPU, `512Mi`, or a plain number of GPUs."""

_FACTORS: Final = {"": Decimal(1), "m": Decimal("0.001")} | {
    letter + ending: Decimal(base) ** power
    for power, letter in enumerate("kMGTP", start=1)
    for ending, base in (("", 1000), ("i", 1024))
}


def amount(quantity: str) -> Decimal:
    """Return the number that a Quantity stands for: `500m` -> 0.5, `1Ki` -> 1024."""
    number = quantity.rstrip("mkKMGTPi")
    unit = quantity[len(number) :]
    return Decimal(number) * _FACTORS[unit.replace("Ki", "ki")]


_SIZE: Final = r"^[1-9][0-9]{0,6}(Ki|Mi)$"


def parse_size(text: object) -> int:
    """Return `text` (`64Ki`, `8Mi`) in bytes.

    Raises:
        ValueError: the message says how a size is written.
    """
    if not isinstance(text, str) or not re.fullmatch(_SIZE, text):
        shown = repr(text)[:40] if isinstance(text, str | int | float) else "this"
        raise ValueError(f"{shown} is not a size; write a whole number and Ki or Mi, such as 64Ki or 8Mi")
    return int(text[:-2]) * (1024 if text.endswith("Ki") else 1024 * 1024)


def format_size(size: int) -> str:
    """Return `size` in bytes with the largest unit that divides it: 8388608 -> `8Mi`."""
    return f"{size // 1024**2}Mi" if size % 1024**2 == 0 else f"{size // 1024}Ki"


class _SizeType:
    """Tells pydantic how a size is read, written and described."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            parse_size,
            serialization=core_schema.plain_serializer_function_ser_schema(
                format_size, return_schema=core_schema.str_schema()
            ),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"type": "string", "pattern": _SIZE, "minLength": 3, "maxLength": 9}


@dataclass(frozen=True)
class UpTo:
    """The largest size that is allowed; given and shown as text.

    Attributes:
        maximum: `16Mi`.
    """

    maximum: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        rule = f"quantity(self).compareTo(quantity('{self.maximum}')) <= 0"
        described = handler(schema)
        described["x-kubernetes-validations"] = [{"rule": rule, "message": f"must be at most {self.maximum}"}]
        return described

    def _check(self, value: int) -> int:
        if value > parse_size(self.maximum):
            raise ValueError(f"{format_size(value)} is out of range; it must be at most {self.maximum}")
        return value


Size = Annotated[int, _SizeType()]
"""Bytes in Python, text with a unit in YAML. Combine it with `UpTo`."""
