"""A feature of an image: it owns its options, its rules and its text, which exist only together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

from robot_offload.api.v1alpha1.model import Model
from robot_offload.findings import Finding

Stage: TypeAlias = Literal["sources", "dependencies", "builder", "runtime"]
FlagKind: TypeAlias = Literal["text", "texts", "number", "switch"]

Spec_contra = TypeVar("Spec_contra", bound=Model, contravariant=True)


@dataclass(frozen=True, slots=True)
class Flag:
    """A command line option that sets one field.

    Attributes:
        option: e.g. `--git`.
        field: the field it sets, as in YAML: `git.url`. Two kinds of text are split: a list of variables
            (`env`, NAME=VALUE each) and a mapping (`labels`, NAME=VALUE each).
        help: one or two sentences.
        kind: `texts` may be given several times, a `switch` has no value.
        metavar: name of its value in the help text.
    """

    option: str
    field: str
    help: str
    kind: FlagKind = "text"
    metavar: str = "TEXT"


class Feature(Generic[Spec_contra]):
    """One feature. Its text for a stage is the template `<name>.<stage>.j2`, filled from `values`.

    Attributes:
        name: one word.
        stages: the stages in which it writes something, if wanted.
        flags: its options.
    """

    name: ClassVar[str]
    stages: ClassVar[tuple[Stage, ...]] = ()
    flags: ClassVar[tuple[Flag, ...]] = ()

    def wanted(self, spec: Spec_contra) -> bool:
        """Return whether this image uses the feature."""
        return True

    def check(self, spec: Spec_contra) -> Iterator[Finding]:
        """Check the feature's rules between fields, whether it is wanted or not."""
        yield from ()

    def packages(self, spec: Spec_contra, stage: Stage) -> tuple[str, ...]:
        """Return the Debian packages that the feature needs in a stage."""
        return ()

    def values(self, spec: Spec_contra) -> Mapping[str, Any]:
        """Return the values for its templates."""
        return {}
