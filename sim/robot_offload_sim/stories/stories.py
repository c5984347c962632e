"""All stories by name: small worlds in virtual time, one rule each. A story raises when its rule does not hold."""

from __future__ import annotations

from collections.abc import Callable

from robot_offload_sim.stories import (
    active_while,
    calls,
    fence,
    garbage,
    gate,
    goals,
    graphs,
    hot,
    inhibit,
    lacks,
    late,
    link,
    mirrors,
    narrow,
    nodes,
    people,
    plain,
    processes,
    results,
    shared,
    states,
    used,
    versions,
)

STORIES: dict[str, Callable[[], None]] = {
    story.__name__: story
    for module in (
        link,
        fence,
        gate,
        people,
        nodes,
        graphs,
        inhibit,
        processes,
        narrow,
        late,
        results,
        plain,
        hot,
        goals,
        calls,
        shared,
        used,
        mirrors,
        lacks,
        active_while,
        states,
        garbage,
        versions,
    )
    for story in module.STORIES
}
