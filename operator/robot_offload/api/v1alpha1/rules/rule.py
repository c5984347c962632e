"""A rule between fields, said once for both who judge it: the API server (in CEL) and Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.findings import Check
from robot_offload.findings import Finding, Severity


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule, which the API server judges when an object is written, and Python whenever one is read.

    The CEL text must hold for an object whose defaults the API server has filled in and from which it has dropped
    nulls; what has no default may be missing.

    Attributes:
        path: the object that it is about, e.g. `spec.nodes[]` for each node.
        reason: one CamelCase word for machines.
        cel: what must hold; `self` is the object at `path`.
        broken: the opposite in Python, of the model at `path`.
        message: what is wrong and what to write instead.
        field: the field of it that the message is shown with; empty: the object itself.
        hint: the figures or names of the case at hand, which only Python adds to the message.
        cluster_only: whether a run on one machine does without it.
        alone: how bad it is on one machine, where a rule of clusters is judged there as well.
    """

    path: str
    reason: str
    cel: str
    broken: Callable[[Any], bool]
    message: str
    field: str = ""
    hint: Callable[[Any], str] | None = None
    cluster_only: bool = False
    alone: Severity = "error"

    def schema(self) -> dict[str, Any]:
        """Return the rule as it stands in `x-kubernetes-validations`."""
        where = {"fieldPath": f".{self.field}"} if self.field else {}
        return {"rule": self.cel, "message": self.message, **where}

    def check(self, severity: Severity = "error") -> Check:
        """Return the rule as a check of a whole specification."""

        def judge(spec: RobotOffloadSpec) -> Iterator[Finding]:
            for path, part in parts_at(spec, self.path):
                if self.broken(part):
                    where = f"{path}.{self.field}" if self.field else path
                    hint = f" ({self.hint(part)})" if self.hint else ""
                    yield Finding(where, self.reason, f"{self.message}{hint}", severity)

        return judge


def parts_at(spec: RobotOffloadSpec, path: str) -> Iterator[tuple[str, Any]]:
    """Everything that stands at `path` of a specification, each with its own path: `spec.nodes[]`, `spec.transport`."""
    found: list[tuple[str, Any]] = [("spec", spec)]
    for name in path.split(".")[1:]:
        field, many = name.removesuffix("[]"), name.endswith("[]")
        inside = [(f"{where}.{field}", getattr(part, _attribute(type(part), field))) for where, part in found]
        if many:
            inside = [(f"{where}[{i}]", each) for where, entries in inside for i, each in enumerate(entries)]
        found = [(where, part) for where, part in inside if part is not None]
    yield from found


def _attribute(model: type[Model], name: str) -> str:
    """Return the Python name of the field of a model that is called `name` in YAML."""
    return next(attribute for attribute, field in model.model_fields.items() if field.alias == name)
