"""A complete specification for tests, as text and as plain values that a test may change."""

from __future__ import annotations

import copy
from typing import Any

from robot_offload.api.strict_yaml import parse, thaw
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object

SAMPLE = """\
apiVersion: robotoffload.dev/v1alpha1
kind: RobotOffload
metadata: {name: wheelchair-7, labels: {fleet: ward-3}}
spec:
  robot: {rosDistro: jazzy, rmw: rmw_fastrtps_cpp, domainID: 42, namespace: /}
  cloud: {domainID: 43}
  transport: {type: Zenoh, zenoh: {pulsePort: 7447, dataPort: 7448, fallback: true}}
  topics:
    toCloud:
    - {name: /scan, type: sensor_msgs/msg/LaserScan, maxAge: 300ms, maxRate: 20, qos: {reliability: BestEffort}}
    - {name: /odom, maxAge: 200ms}
    - {name: /goal_pose, latched: true, qos: {durability: TransientLocal, depth: 1}}
  driver: {inhibitService: /wheels_control/inhibit}
  nodes:
  - name: wheelchair_base
    placement: Robot
    lifecycle: false
    run: {command: [python3, wheelchair.py]}
  - name: controller
    placement: Duplicated
    core: true
    standby: {robot: Warm, cloud: Hot}
    run:
      command: [python3, controller.py]
      parameters: {rate_hz: 20.0, max_speed: 0.6, plugins: {names: [a, b]}}
      cloudParameters: {rate_hz: 50.0, max_speed: 0.9}
      doubles: [rate_hz]
      remap: {cmd_vel_nav: /cmd_vel}
    image: registry.example/controller:1
    outputs:
    - {topic: /cmd_vel, type: geometry_msgs/msg/TwistStamped, rate: 20, deadline: 150ms, mirror: false}
  - name: planner
    placement: Cloud
    run: {package: nav2_planner, executable: planner_server}
    image: registry.example/nav2:1
  switching:
    prefer: Cloud
    heartbeatPeriod: 20ms
    lossTimeout: 90ms
    lease: 250ms
    maxCommandAge: 150ms
    latency: {robotPeriod: 50ms, cloudPeriod: 20ms, tolerance: 30ms}
    minDwell: 0s
    mode: Auto
    pin: Auto
    maxClockOffset: 20ms
    activationDeadline: 250ms
    strict: false
    holdDown: {initial: 1s, max: 30s, flapWindow: 5s}
"""
MINIMAL = """\
apiVersion: robotoffload.dev/v1alpha1
kind: RobotOffload
metadata: {name: talker}
spec:
  nodes: [{name: talker, placement: Duplicated, image: registry.example/talker:1}]
"""


def sample() -> dict[str, Any]:
    """The sample as plain values, a fresh copy each time."""
    values = thaw(parse(SAMPLE))
    assert isinstance(values, dict)
    return copy.deepcopy(values)


def sample_with(path: str, value: Any) -> RobotOffload:
    """The sample with one field changed; `path` as in `spec.nodes.1.name`."""
    return parse_object(changed(path, value), "test.yaml")


def changed(path: str, value: Any) -> dict[str, Any]:
    """The sample's plain values with one field changed, or removed if the value is `...`."""
    values = sample()
    *parents, last = path.split(".")
    target: Any = values
    for part in parents:
        target = target[int(part)] if part.isdigit() else target.setdefault(part, {})
    key: Any = int(last) if last.isdigit() else last
    if value is ...:
        del target[key]
    elif isinstance(target, list) and key == len(target):
        target.append(value)
    else:
        target[key] = value
    return values
