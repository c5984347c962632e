"""Words of the resource that this version knows and does not do yet: each is refused, with what to do meanwhile.

Who finishes a word, from the resource to the running nodes, removes its entry here; nothing else keeps it back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1.rules.rule import Rule

REASON: Final = "NotYet"


@dataclass(frozen=True, slots=True)
class Word:
    """A word that is refused.

    Attributes:
        path: the object in which it stands.
        field: its name there.
        unused: CEL that holds where the word is not used.
        used: the opposite in Python, of the model at `path`.
        meanwhile: what to do without it.
        example: (place in the sample, value) that uses it.
    """

    path: str
    field: str
    unused: str
    used: Callable[[Any], bool]
    meanwhile: str
    example: tuple[str, Any]

    def rule(self) -> Rule:
        """Return the refusal as a rule of the CRD."""
        message = f"{self.field} is not built yet; {self.meanwhile}"
        return Rule(self.path, REASON, self.unused, self.used, message, self.field)


NOT_YET: Final[dict[str, Word]] = {}


def built(word: str) -> bool:
    """Return whether a word, by its key in NOT_YET, does what its description says."""
    return word not in NOT_YET


RULES: Final[tuple[Rule, ...]] = tuple(word.rule() for word in NOT_YET.values())
