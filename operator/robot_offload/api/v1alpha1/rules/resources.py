"""Rules about computing resources, as Kubernetes has them for containers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.api.v1alpha1.name_rules import cel_list
from robot_offload.api.v1alpha1.quantities import amount
from robot_offload.api.v1alpha1.resources import Resources
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.rule import Rule, parts_at
from robot_offload.findings import Finding

_DIVISIBLE: Final = ("cpu", "memory", "ephemeral-storage")
_HUGE_PAGES: Final = "hugepages-"
_PLACES: Final = ("spec.nodes[].resources", "spec.nodes[].build.resources")
_AMOUNT: Final = "quantity(string(self.{}[name]))"
_REQUEST, _LIMIT = _AMOUNT.format("requests"), _AMOUNT.format("limits")


def _more_than_the_limit(it: Resources) -> bool:
    return any(amount(value) > amount(it.limits[name]) for name, value in it.requests.items() if name in it.limits)


def _shared_in_parts(it: Resources) -> bool:
    given = [item for mapping in (it.limits, it.requests) for item in mapping.items()]
    return any(name not in _DIVISIBLE and amount(value) % 1 for name, value in given)


def _not_the_limit(it: Resources) -> bool:
    return any(_without_its_limit(name, value, it.limits) for name, value in it.requests.items())


def _without_its_limit(name: str, value: str, limits: Mapping[str, str]) -> bool:
    return name not in _DIVISIBLE and (name not in limits or amount(limits[name]) != amount(value))


def _rules_at(path: str) -> tuple[Rule, ...]:
    whole = f"name in {cel_list(_DIVISIBLE)}"
    return (
        Rule(
            path,
            "OutOfRange",
            f"!has(self.requests) || !has(self.limits) || self.requests.all(name, !(name in self.limits) || "
            f"{_REQUEST}.compareTo({_LIMIT}) <= 0)",
            _more_than_the_limit,
            "a request is more than its limit; lower it or raise the limit",
            "requests",
        ),
        Rule(
            path,
            "Invalid",
            f"(!has(self.limits) || self.limits.all(name, {whole} || {_LIMIT}.isInteger())) && "
            f"(!has(self.requests) || self.requests.all(name, {whole} || {_REQUEST}.isInteger()))",
            _shared_in_parts,
            "devices such as GPUs, and huge pages, come whole; write a whole number",
        ),
        Rule(
            path,
            "Required",
            f"!has(self.requests) || self.requests.all(name, {whole} || (has(self.limits) && name in self.limits && "
            f"{_REQUEST}.compareTo({_LIMIT}) == 0))",
            _not_the_limit,
            "devices such as GPUs, and huge pages, are not shared; write the same number under limits",
            "requests",
        ),
    )


RULES: Final[tuple[Rule, ...]] = tuple(rule for path in _PLACES for rule in _rules_at(path))


def resources_are_known(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Kubernetes has few resources of its own; those of devices carry the name of their maker."""
    for path, found in (found for place in _PLACES for found in parts_at(spec, place)):
        yield from _unknown(path, found)


def _unknown(path: str, found: Any) -> Iterator[Finding]:
    for field, mapping in (("limits", found.limits), ("requests", found.requests)):
        for name in mapping:
            if "/" not in name and name not in _DIVISIBLE and not name.startswith(_HUGE_PAGES):
                yield Finding(
                    f"{path}.{field}",
                    "NotSupported",
                    f"{name!r} is not a resource of a container; write cpu, memory, ephemeral-storage, "
                    "hugepages-<size> or the name of a device, such as nvidia.com/gpu",
                )
