"""The base of all API models: how field names are written in YAML, and that nothing unknown passes."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel, ConfigDict

_UNITS: Final = ("_ms", "_hz")
_ACRONYMS: Final = {"id": "ID"}

NO_SERVER_DEFAULT: Final[dict[str, Any]] = {"x-no-server-default": True}
"""Marks a block that the API server must not fill in, because leaving it out means something."""


def map_list(key: str) -> dict[str, Any]:
    """Mark a list whose entries are told apart by the field `key`: each may occur once, each has one owner."""
    return {"x-kubernetes-list-type": "map", "x-kubernetes-list-map-keys": [key]}


def yaml_name(field: str) -> str:
    """Return the name of a field in YAML: `loss_timeout_ms` -> `lossTimeout`, `domain_id` -> `domainID`.

    Python names carry their unit, YAML values do (`90ms`), so the suffix is left out. A word that Python keeps for
    itself carries an underscore there: `while_` -> `while`.
    """
    for unit in _UNITS:
        field = field.removesuffix(unit)
    first, *rest = field.rstrip("_").split("_")
    return first + "".join(_ACRONYMS.get(word, word.capitalize()) for word in rest)


class Model(BaseModel):
    """An immutable part of the resource. Lists are tuples; unknown fields are refused."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        alias_generator=yaml_name,
        validate_by_name=True,
        validate_by_alias=True,
        serialize_by_alias=True,
        use_attribute_docstrings=False,
        hide_input_in_errors=True,
    )
