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
        """The refusal as a rule of the CRD."""
        message = f"{self.field} is not built yet; {self.meanwhile}"
        return Rule(self.path, REASON, self.unused, self.used, message, self.field)


def _without(field: str) -> str:
    return f"!has(self.{field})"


def _empty(field: str) -> str:
    return f"!has(self.{field}) || size(self.{field}) == 0"


_NODE, _SWITCHING = "spec.nodes[]", "spec.switching"
_ACTION, _STATE = "spec.nodes[].actions[]", "spec.nodes[].state[]"
_IN_NODE = "spec.nodes.1"
_PLAN = {"name": "/make_plan", "type": "nav_msgs/srv/GetPlan"}
_FOLLOW = {"name": "/follow_path", "type": "nav2_msgs/action/FollowPath"}

NOT_YET: Final[dict[str, Word]] = {
    "Race": Word(
        "spec.nodes[].services[]", "mode", "self.mode != 'Race'", lambda it: it.mode == "Race",
        "write Idempotent instead of Race",
        (f"{_IN_NODE}.services", [_PLAN | {"mode": "Race"}]),
    ),
    "mirror": Word(
        _ACTION, "mirror", "!self.mirror", lambda it: it.mirror, "the robot gets the goal after a loss without it",
        (f"{_IN_NODE}.actions", [_FOLLOW | {"onSwitch": "Resend", "mirror": True}]),
    ),
    "cloudNames": Word(
        _NODE, "placement",
        "self.placement != 'Cloud' || !((has(self.services) && size(self.services) > 0) || "
        "(has(self.actions) && size(self.actions) > 0))",
        lambda it: it.placement == "Cloud" and bool(it.offered),
        "only Duplicated nodes offer services and actions to the robot; let a Cloud node publish its results",
        ("spec.nodes.2.services", [_PLAN]),
    ),
    "uses": Word(
        _NODE, "uses",
        "!has(self.uses) || ((!has(self.uses.services) || size(self.uses.services) == 0) && "
        "(!has(self.uses.actions) || size(self.uses.actions) == 0))",
        lambda it: bool(it.called), "let the node call what its own side offers",
        (f"{_IN_NODE}.uses", {"services": [_PLAN]}),
    ),
    "stateTopic": Word(
        _STATE, "topic", _without("topic"), lambda it: it.topic is not None,
        "let the node publish a snapshot, or find its state again from its inputs",
        (f"{_IN_NODE}.state", [{"topic": "/amcl_pose", "restore": "/initialpose"}]),
    ),
    "stateParameters": Word(
        _STATE, "parameters", _without("parameters"), lambda it: it.parameters is not None,
        "set the parameters on both sides", (f"{_IN_NODE}.state", [{"parameters": {}}]),
    ),
    "maxMessageSize": Word(
        _SWITCHING, "maxMessageSize", "quantity(self.maxMessageSize).compareTo(quantity('8Mi')) == 0",
        lambda it: it.max_message_size != 8 * 1024 * 1024, "leave it out", (f"{_SWITCHING}.maxMessageSize", "1Mi"),
    ),
}  # fmt: skip


def built(word: str) -> bool:
    """Whether a word, by its key in NOT_YET, does what its description says."""
    return word not in NOT_YET


RULES: Final[tuple[Rule, ...]] = tuple(word.rule() for word in NOT_YET.values())
