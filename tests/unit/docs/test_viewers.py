"""The layout for viewers has the form that viewers import, and names what the agent publishes."""

from typing import Any

from robot_offload_agent.record.mcap.topics import topics
from robot_offload_agent.ros.interfaces import message_type
from robot_offload_agent.settings import parameters
from tests.viewers import foxglove, shown


def leaves(node: Any) -> set[str]:
    return {node} if isinstance(node, str) else leaves(node["first"]) | leaves(node["second"])


def test_the_layout_has_the_old_form_that_foxglove_and_lichtblick_import() -> None:
    layout = foxglove()
    assert {"configById", "layout", "globalVariables", "userNodes", "playbackConfig"} == set(layout)
    assert leaves(layout["layout"]) == set(layout["configById"])


def test_every_topic_of_the_layout_is_recorded_with_the_field_that_is_drawn() -> None:
    configuration = parameters.parse({"side": "robot", "uid": "chair"})
    recorded = {topic.name: topic.type_name for topic in topics(configuration)}
    for topic, field in shown():
        assert topic in recorded
        assert not field or field in message_type(recorded[topic]).get_fields_and_field_types()
