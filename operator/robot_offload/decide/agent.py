"""The cloud agent's report about its robot, from the robot's Lease."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from robot_offload.api.agent_state import ANNOTATION, AgentState, StateError, parse_state
from robot_offload.decide.verdicts import Verdict, no, unknown, yes
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint

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
    """Return the agent's state on the Lease, or None and the problem with it."""
    text = ((lease or {}).get("metadata", {}).get("annotations") or {}).get(ANNOTATION)
    if not text:
        return None, "the cloud agent has not reported yet"
    try:
        return parse_state(text), ""
    except StateError as error:
        return None, str(error)


def placement(state: AgentState | None, problem: str, *, connected: bool) -> Placement:
    """Return the side that the robot chose; Unknown without a connected robot, which then acts by itself."""
    if not connected:
        return Placement("Unknown", "NotConnected", "The robot is not connected; it acts by itself")
    if state is None:
        return Placement("Unknown", "NotReported", problem)
    return Placement(_SITES.get(state.site, "Unknown"), state.reason, state.message)


def dialled(state: AgentState | None, before: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the addresses in the robot's bundle, from its present or last report; none: it never reported any.

    Args:
        state: of the cloud's agent.
        before: `status.robot` as it was last written.
    """
    return (state.dials if state is not None else ()) or tuple(before.get("dials") or ())


def lost(dials: Collection[str], endpoints: Iterable[Endpoint]) -> tuple[Endpoint, ...]:
    """Return the cloud's endpoints for a purpose if no dialled address leads to any of them."""
    by_purpose: dict[str, list[Endpoint]] = {}
    for point in endpoints:
        if point.purpose in ("pulse", "data"):
            by_purpose.setdefault(point.purpose, []).append(point)
    unreached = (them for them in by_purpose.values() if not any(one.address in dials for one in them))
    return tuple(next(unreached, ())) if dials else ()


def config_current(
    state: AgentState | None,
    generation: int,
    *,
    connected: bool,
    dials: Collection[str] = (),
    endpoints: Iterable[Endpoint] = (),
) -> Verdict:
    """Return whether the robot runs this generation's settings and dials the cloud (condition ConfigCurrent).

    Args:
        state: of the cloud's agent.
        generation: of the specification.
        connected: whether the robot is.
        dials: addresses in its bundle.
        endpoints: the cloud's present addresses.
    """
    gone = lost(dials, endpoints)
    if gone:
        now = ", ".join(point.address for point in gone)
        return no(
            "BundleOutdated",
            f"The robot's bundle dials {', '.join(dials)}, and the cloud is reached at {now} now: the robot may not "
            "come back after its next loss of the link. Write its bundle again; with expose.host it dials a name",
        )
    if not connected:
        return unknown("NotConnected", "The robot's settings are not known until it is connected")
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
