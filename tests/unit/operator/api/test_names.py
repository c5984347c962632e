"""Names are refused with advice where they are written."""

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.errors import SpecError
from tests.unit.specs import changed

CASES = [
    ("metadata.name", "Wheelchair_7", "is not a Kubernetes name"),
    ("metadata.name", "a" * 64, "at most 63"),
    ("spec.robot.namespace", "robot", "with a slash first"),
    ("spec.robot.namespace", "/robot/", "with a slash first"),
    ("spec.robot.rmw", "fastrtps", "is not a ROS middleware"),
    ("spec.driver.inhibitService", "inhibit", "must start with a slash"),
    ("spec.topics.toCloud.0.name", "scan", "must start with a slash"),
    ("spec.topics.toCloud.0.name", "/scan/", "is not a full name"),
    ("spec.topics.toCloud.0.name", "/1scan", "is not a full name"),
    ("spec.topics.toCloud.0.name", "/a//b", "is not a full name"),
    ("spec.topics.toCloud.0.name", "/a__b", "two underscores in a row"),
    ("spec.topics.toCloud.0.name", "/" + "a" * 233, "at most 233"),
    ("spec.topics.toCloud.0.name", "/offload/placement", "belongs to the agents"),
    ("spec.topics.toCloud.0.name", "/network_status", "belongs to the agents"),
    ("spec.topics.toCloud.0.type", "sensor_msgs/LaserScan", "write package/msg/Type"),
    ("spec.topics.toCloud.0.type", "std_srvs/srv/SetBool", "write package/msg/Type"),
    ("spec.nodes.1.name", "/controller", "without its namespace"),
    ("spec.nodes.1.name", "2nd", "is not a node name"),
    ("spec.nodes.1.name", "remote_controller", "the prefix of cloud replicas"),
    ("spec.nodes.1.name", "guardian", "one of the agent's own nodes"),
    ("spec.nodes.1.image", "my image", "is not an image"),
    ("spec.nodes.2.run.package", "Nav2", "is not a ROS package"),
    ("spec.nodes.2.run.executable", "bin/planner", "without a folder"),
]


@pytest.mark.parametrize(("path", "value", "advice"), CASES)
def test_a_bad_name_is_refused_with_advice(path: str, value: str, advice: str) -> None:
    with pytest.raises(SpecError) as caught:
        parse_object(changed(path, value), "f.yaml")
    [finding] = caught.value.findings
    assert finding.path.replace("[", ".").replace("]", "") == path
    assert advice in finding.message


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("metadata.name", "a"),
        ("spec.robot.namespace", "/wards/wheelchair_7"),
        ("spec.topics.toCloud.0.name", "/front/scan_raw"),
        ("spec.topics.toCloud.0.name", "/" + "a" * 232),
        ("spec.topics.toCloud.0.type", "my_robot_msgs/msg/Scan3D"),
        ("spec.nodes.1.name", "controller_server2"),
        ("spec.nodes.1.image", f"registry.example:5000/team/nav2@sha256:{'0123456789abcdef' * 4}"),
    ],
)
def test_a_good_name_is_taken(path: str, value: str) -> None:
    parse_object(changed(path, value), "f.yaml")
