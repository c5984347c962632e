"""All stories by name: small worlds in virtual time, one rule each. A story raises when its rule does not hold."""

from __future__ import annotations

from collections.abc import Callable

from robot_offload_lab.simulate import (
    story_calls,
    story_fence,
    story_garbage,
    story_gate,
    story_goals,
    story_graphs,
    story_hot,
    story_inhibit,
    story_lacks,
    story_late,
    story_link,
    story_mirrors,
    story_narrow,
    story_nodes,
    story_people,
    story_plain,
    story_processes,
    story_results,
    story_shared,
    story_states,
    story_used,
    story_while,
)

STORIES: dict[str, Callable[[], None]] = {
    story.__name__: story
    for module in (
        story_link,
        story_fence,
        story_gate,
        story_people,
        story_nodes,
        story_graphs,
        story_inhibit,
        story_processes,
        story_narrow,
        story_late,
        story_results,
        story_plain,
        story_hot,
        story_goals,
        story_calls,
        story_shared,
        story_used,
        story_mirrors,
        story_lacks,
        story_while,
        story_states,
        story_garbage,
    )
    for story in module.STORIES
}
