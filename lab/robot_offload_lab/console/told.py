"""A run as the console's events: what `LiveRun` knows at a moment, and the changeovers it has seen. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from robot_offload.console.live import CLOUD, ROBOT, Changeover, Errand, Key, Live, NodeState, TopicFlow
from robot_offload.console.model import Event, Said, Switched
from robot_offload_lab.show.watch import LiveRun


class Teller:
    """Turns what is new in a run into events for a console.

    Args:
        key: of the robot.
        offset_s: added to the steady clock of the run.
    """

    def __init__(self, key: Key, offset_s: float) -> None:
        self._key = key
        self._offset_s = offset_s
        self._told: dict[float, float | None] = {}

    def tell(self, watch: LiveRun, now_s: float, cloud: Live | None = None) -> Iterator[Event]:
        """Yield the events since the last call and the present state; `cloud` is the cloud agent's own report."""
        for switch in watch.switches:
            if switch.t_s not in self._told or self._told[switch.t_s] != switch.gap_ms:
                self._told[switch.t_s] = switch.gap_ms
                t_s = switch.t_s + self._offset_s
                yield Switched(self._key, Changeover(t_s, switch.to, switch.reason, "", switch.gap_ms))
        yield Said(self._key, now_s + self._offset_s, live(watch, cloud))


def live(watch: LiveRun, cloud: Live | None = None) -> Live:
    """Return the state of a run; `cloud` adds what only the cloud's agent knows."""
    change, link = watch.placement, watch.link
    cut = link is not None and link.rtt_ms is None
    scheduled_ms = link.rtt_ms if link is not None else None
    found = Live(
        site=change.site if change else "unknown",
        reason=change.reason if change else "",
        message=change.message if change else "",
        epoch=change.epoch if change else 0,
        connected=not cut,
        latency_ms=watch.round_trip_ms if link is None else scheduled_ms,
        cut=cut,
        p50_ms=watch.round_trip_ms,
        nodes=tuple(NodeState(name, ROBOT, state) for name, state in watch.nodes.items()),
        topics=tuple(
            TopicFlow(topic, count, age_ms=watch.ages_ms.get(topic)) for topic, count in watch.received.items()
        ),
        goals=tuple(
            Errand(f"goal {goal.goal}", goal.ending or "on the way", f"{goal.feedback} feedback, {goal.servers} turns")
            for goal in watch.goals.values()
        ),
        services=_calls(watch),
        state_ages_ms=tuple(
            (name, restored.age_s * 1e3) for name, restored in watch.restored.items() if restored.age_s is not None
        ),
        numbers=tuple(_drive(watch.drive)),
    )
    if cloud is None:
        return found
    carried = tuple(flow for flow in cloud.topics if flow.topic not in watch.received)
    nodes = (*found.nodes, *(node for node in cloud.nodes if node.side == CLOUD))
    return replace(
        found, nodes=nodes, topics=(*found.topics, *carried), p99_ms=cloud.p99_ms, loss_share=cloud.loss_share
    )


def _calls(watch: LiveRun) -> tuple[Errand, ...]:
    if watch.calls is None:
        return ()
    calls = watch.calls
    detail = f"{calls.answered} answered, {calls.failed} failed, longest {calls.longest_ms:.0f} ms"
    return (Errand("calls of a service", f"{calls.asked} asked", detail),)


def _drive(drive: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name in ("speed_mps", "x_m", "collisions", "stops"):
        if name in drive:
            value = drive[name]
            yield name, f"{value:.2f}" if isinstance(value, float) else str(value)
