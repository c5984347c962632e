"""What the cloud agent says about its robot, through the robot's Lease."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from robot_offload.api.agent_state import ANNOTATION, AgentState, StateError, parse_state
from robot_offload.decide.verdicts import Verdict, no, unknown, yes
from robot_offload.kube.port import Manifest

Site: TypeAlias = Literal["Robot", "Cloud", "Unknown"]
_SITES: Final[dict[str, Site]] = {"robot": "Robot", "cloud": "Cloud"}


@dataclass(frozen=True, slots=True)
class Placement:
    """Which side acts.

    Attributes:
        site: Robot, Cloud or Unknown.
        reason: one CamelCase word.
        message: a sentence.
    """

    site: Site
    reason: str
    message: str


def state_of(lease: Manifest | None) -> tuple[AgentState | None, str]:
    """The agent's state on the Lease, or None and what is wrong with it."""
    text = ((lease or {}).get("metadata", {}).get("annotations") or {}).get(ANNOTATION)
    if not text:
        return None, "the cloud agent has not reported yet"
    try:
        return parse_state(text), ""
    except StateError as error:
        return None, str(error)


def placement(state: AgentState | None, problem: str, *, connected: bool) -> Placement:
    """Which side acts, as the robot decided; unknown without a robot: it then acts by itself."""
    if not connected:
        return Placement("Unknown", "NotConnected", "The robot is not connected; it acts by itself")
    if state is None:
        return Placement("Unknown", "NotReported", problem)
    return Placement(_SITES.get(state.site, "Unknown"), state.reason, state.message)


def config_current(state: AgentState | None, generation: int, *, connected: bool) -> Verdict:
    """Whether the robot runs the settings of this generation, for the condition ConfigCurrent."""
    if not connected:
        return unknown("NotConnected", "Nobody can tell which settings the robot runs until it is connected")
    if state is None or (state.settings.robot_generation is None and state.settings.accepted is None):
        return unknown("NotReported", "The robot has not said yet which settings it runs")
    settings = state.settings
    if settings.accepted is False:
        return no(
            settings.reason or "Refused",
            f"The robot keeps generation {settings.robot_generation or 'of its bundle'}: "
            f"{settings.message or 'it refused the new settings'}",
        )
    if settings.robot_generation == generation:
        return yes("Current", f"The robot runs generation {generation}")
    return no("Pending", f"The robot runs generation {settings.robot_generation}, {generation} is on its way")
