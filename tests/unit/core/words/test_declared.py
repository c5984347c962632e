"""Services, actions, used names, state and conditions that cannot work are named before anything starts."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.words.declared import (
    LARGEST_SNAPSHOT,
    ActionSpec,
    Frame,
    OnSwitch,
    ParameterState,
    ServiceMode,
    ServiceSpec,
    SettingsError,
    SnapshotState,
    TopicState,
    UsedAction,
    UsedService,
    While,
)
from robot_offload_core.words.settings import InputSpec, NodeSpec, OutputSpec

PLAN = ("/make_plan", "nav_msgs/srv/GetPlan")
FOLLOW = ("/follow_path", "nav2_msgs/action/FollowPath")
BOTH_SIDES = (Site.ROBOT, Site.CLOUD)


@pytest.mark.parametrize(
    "spec",
    [
        While(("/follow_path", "/spin")),
        While(topic="/image", within_s=0.2),
        Frame("map", "odom"),
        ServiceSpec(*PLAN),
        ServiceSpec(*PLAN, mode=ServiceMode.BOTH),
        ActionSpec(*FOLLOW, OnSwitch.HOLD),
        ActionSpec(*FOLLOW, OnSwitch.RESEND, mirror=True, hot=BOTH_SIDES),
        UsedService(*PLAN),
        UsedAction(*FOLLOW, cancel_after_s=0.0),
        TopicState("amcl", "/amcl_pose", "/initialpose"),
        ParameterState("amcl", ("amcl", "local_costmap")),
        SnapshotState("slam", max_size=LARGEST_SNAPSHOT),
        OutputSpec("plan", 0.0),
        OutputSpec("cmd_vel", 0.15, 0.05, While(("/follow_path",))),
        OutputSpec("tf", 0.0, frames=(Frame("map", "odom"),), shared=True),
        InputSpec("/scan", 0.3, 10.0, 2.0),
        NodeSpec("detector", lifecycle=False, hot=True),
        NodeSpec("driver", duplicated=False, lifecycle=False),
    ],
    ids=lambda spec: type(spec).__name__,
)
def test_what_a_user_may_declare_passes(spec: Any) -> None:
    spec.check()


@pytest.mark.parametrize(
    ("field", "spec"),
    [
        ("while", While()),
        ("while", While(("/spin",), "/image", 0.2)),
        ("while.actions", While(("spin",))),
        ("while.topic", While(topic="image", within_s=0.2)),
        ("while.within_s", While(topic="/image")),
        ("frames.parent", Frame("/map", "odom")),
        ("frames.child", Frame("map", "")),
        ("frames.child", Frame("map", "map")),
        ("name", ServiceSpec("make_plan", "nav_msgs/srv/GetPlan")),
        ("type", ServiceSpec("/make_plan", "nav_msgs/GetPlan")),
        ("type", ServiceSpec("/make_plan", "nav2_msgs/action/FollowPath")),
        ("timeout_s", ServiceSpec(*PLAN, timeout_s=0.0)),
        ("timeout_s", ServiceSpec(*PLAN, timeout_s=float("nan"))),
        ("mode", ServiceSpec(*PLAN, mode=ServiceMode.BOTH, of_cloud=True)),
        ("mode", ServiceSpec(*PLAN, mode=ServiceMode.RACE, of_cloud=True)),
        ("type", ActionSpec("/follow_path", "nav_msgs/srv/GetPlan", OnSwitch.ABORT)),
        ("hold_for_s", ActionSpec(*FOLLOW, OnSwitch.HOLD, hold_for_s=0.0)),
        ("result_timeout_s", ActionSpec(*FOLLOW, OnSwitch.HOLD, result_timeout_s=-1.0)),
        ("mirror", ActionSpec(*FOLLOW, OnSwitch.ABORT, mirror=True, hot=BOTH_SIDES)),
        ("mirror", ActionSpec(*FOLLOW, OnSwitch.RESEND, mirror=True)),
        ("type", UsedService("/make_plan", "GetPlan")),
        ("name", UsedAction("/spin ", "nav2_msgs/action/Spin")),
        ("cancel_after_s", UsedAction(*FOLLOW, cancel_after_s=-0.1)),
        ("restore", TopicState("amcl", "/amcl_pose", "/amcl_pose")),
        ("topic", TopicState("amcl", "amcl_pose", "/initialpose")),
        ("nodes", ParameterState("amcl", ("amcl", "amcl"))),
        ("max_size", SnapshotState("slam", max_size=LARGEST_SNAPSHOT + 1)),
        ("max_size", SnapshotState("slam", max_size=0)),
        ("max_age_s", SnapshotState("slam", max_age_s=0.0)),
        ("deadline_s", OutputSpec("cmd_vel", 0.04, 0.05)),
        ("while", OutputSpec("cmd_vel", 0.0, while_=While(("/spin",)))),
        ("shared", OutputSpec("tf", 0.0, frames=(Frame("map", "odom"),))),
        ("frames.child", OutputSpec("tf", 0.0, frames=(Frame("map", "odom"), Frame("world", "odom")), shared=True)),
        ("max_age_s", OutputSpec("cmd_vel", max_age_s=-1.0)),
        ("min_rate_hz", InputSpec("/scan", 0.0, 5.0, 10.0)),
        ("max_rate_hz", InputSpec("/scan", 0.0, float("nan"))),
        ("hot", NodeSpec("detector", lifecycle=False)),
    ],
)  # fmt: skip
def test_what_cannot_work_is_named_first_in_the_message(field: str, spec: Any) -> None:
    with pytest.raises(SettingsError) as caught:
        spec.check()
    assert str(caught.value).split(": ", 1)[0] == field
