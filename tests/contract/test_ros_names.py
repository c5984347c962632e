"""Our checks of ROS names hold against ROS's own: what we accept, ROS accepts."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from robot_offload.api.v1alpha1.names import Namespace, NodeName, TopicName
from robot_offload.render.ros_names import private_topic

NAMES = st.text(st.sampled_from("abZ_019/~{}-.é "), max_size=12) | st.from_regex(r"(/[A-Za-z_][A-Za-z0-9_]{0,90}){1,4}")


def accepts(kind: Any, text: str) -> bool:
    try:
        TypeAdapter(kind).validate_python(text)
    except ValidationError:
        return False
    return True


@settings(max_examples=500, deadline=None)
@given(NAMES)
def test_a_topic_that_we_accept_is_valid_in_ros_also_under_its_private_names(text: str) -> None:
    if accepts(TopicName, text):
        for topic in (text, private_topic("robot", text), private_topic("cloud", text)):
            validate_full_topic_name(topic)


@settings(max_examples=300, deadline=None)
@given(NAMES)
def test_nodes_and_namespaces_that_we_accept_are_valid_in_ros(text: str) -> None:
    if accepts(NodeName, text):
        validate_node_name(text)
        validate_node_name(f"remote_{text}")
    if accepts(Namespace, text):
        validate_namespace(text)
