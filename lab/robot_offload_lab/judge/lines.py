"""Records as lines of JSON: one object a line, whose `kind` names its dataclass. Pure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, ClassVar, Final, Generic, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

R = TypeVar("R")
_MISSING: Final = "missing"
_UNKNOWN: Final = ("unexpected_keyword_argument", "extra_forbidden")


class Record:
    """The base of dataclasses that are read from lines: exact types, no unknown fields, finite numbers."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class Lines(Generic[R]):
    """The codec of some kinds of records.

    Args:
        kinds: name in the line -> dataclass.
    """

    def __init__(self, kinds: Mapping[str, type[R]]) -> None:
        self._kinds = {name: TypeAdapter(kind) for name, kind in kinds.items()}
        self._names = {kind: name for name, kind in kinds.items()}

    def encode(self, record: R) -> str:
        """Return a record as one line, without the newline."""
        name = self._names[type(record)]
        return json.dumps({"kind": name, **self._kinds[name].dump_python(record)}, separators=(",", ":"))

    def decode(self, line: str) -> R:
        """Return the record of one line.

        Raises:
            ValueError: the message states what is wrong with the line.
        """
        try:
            values: Any = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"is not JSON ({error})") from error
        name = values.pop("kind", None) if isinstance(values, dict) else None
        if not isinstance(name, str) or name not in self._kinds:
            raise ValueError(f"has no known kind; known are {', '.join(self._kinds)}")
        try:
            return self._kinds[name].validate_json(json.dumps(values))  # strict dataclasses are read from JSON only
        except ValidationError as error:
            raise ValueError(_problem(name, error.errors()[0])) from error


def _problem(kind: str, detail: ErrorDetails) -> str:
    """Return in words what is wrong with a line of a kind."""
    field = ".".join(map(str, detail["loc"]))
    if detail["type"] == _MISSING:
        return f"lacks the field {field} of kind {kind}"
    if detail["type"] in _UNKNOWN:
        return f"has unknown fields for kind {kind}: {field}"
    return f"has {field} = {detail['input']!r}: {detail['msg']}"
