"""Why the robot acts although a cloud is connected: the strongest reason first, with the rule's own numbers. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from robot_offload.insight.observed import Observed


@dataclass(frozen=True, slots=True)
class Stay:
    """The known facts about the robot's turn as active side.

    Attributes:
        site: the active side: robot, cloud or unknown.
        reason, message: why, as the robot's agent reports; the message has the rest of each wait.
        connected: whether the robot is heard.
        latency_ms: loop latency now; None: no loop.
        allowed_ms: loop latency up to which the cloud is worth using; None: not known.
        loss_timeout_ms: silence that counts as a loss; None: not known.
        hold_down_s: first and longest wait after a loss; None: not known.
    """

    site: str
    reason: str
    message: str
    connected: bool
    latency_ms: float | None = None
    allowed_ms: float | None = None
    loss_timeout_ms: float | None = None
    hold_down_s: tuple[float, float] | None = None


def staying(stay: Stay, offload: Observed | None) -> Iterator[str]:
    """Yield why the cloud does not act, one sentence each; if nothing prevents it, one sentence about that."""
    if stay.site == "cloud":
        yield "The cloud acts."
        return
    if offload is not None:
        yield from _wanted(offload)
    if not stay.connected:
        yield "No agent of the robot is heard, so no handover is possible."
        return
    if stay.reason or stay.message:
        yield f"The robot's rule says {stay.reason}: {stay.message or 'it gives no sentence'}."
    yield from _numbers(stay)


def _wanted(offload: Observed) -> Iterator[str]:
    if offload.replicas == 0:
        yield "spec.replicas is 0: the cloud side is switched off."
    if offload.pin == "Robot":
        until = f" until {offload.pinned_until}" if offload.pinned_until else ""
        yield f"It is pinned to the robot{until}; let the rule decide to end that."
    if offload.mode == "Observe":
        yield "spec.switching.mode is Observe: it decides and says so, but never switches."
    if ((offload.spec.get("switching") or {}).get("prefer") or "Cloud") == "Robot":
        yield "spec.switching.prefer is Robot: the cloud acts only while the robot cannot."
    ready = offload.condition("Ready")
    if ready is not None and not ready.holds:
        yield f"The cloud is not Ready: {ready.reason}. {ready.message}".rstrip()


def _numbers(stay: Stay) -> Iterator[str]:
    if stay.allowed_ms is not None:
        if stay.latency_ms is None:
            yield f"The link carries no loop now; the cloud needs one of at most {stay.allowed_ms:.0f} ms."
        elif stay.latency_ms > stay.allowed_ms:
            over_ms = stay.latency_ms - stay.allowed_ms
            yield f"Loop latency {stay.latency_ms:.0f} ms, {over_ms:.0f} ms over the bound of {stay.allowed_ms:.0f} ms."
        else:
            yield f"Loop latency {stay.latency_ms:.0f} ms, within the bound of {stay.allowed_ms:.0f} ms."
    if stay.loss_timeout_ms is not None and stay.hold_down_s is not None:
        first_s, most_s = stay.hold_down_s
        yield (
            f"Silence of {stay.loss_timeout_ms:.0f} ms counts as a loss; after a short stay the cloud waits "
            f"{first_s:g} s, doubled each time up to {most_s:g} s, and 4 s of a good link end every wait."
        )
