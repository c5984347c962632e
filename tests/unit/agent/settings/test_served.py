"""Parameters of services and actions become the core's plan of a relay."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings.parameters import parse
from robot_offload_agent.settings.served import member_in
from robot_offload_core.fence.token import Site
from robot_offload_core.words.declared import (
    Accept,
    ActionSpec,
    OnSwitch,
    ServiceMode,
    ServiceSpec,
    UsedAction,
    UsedService,
)

ACTION = {
    "actions": ["follow"],
    "action.follow.name": "/follow_path",
    "action.follow.type": "test_msgs/action/Fibonacci",
}
SWITCH = {"action.follow.on_switch": "Resend"}


def given(**different: Any) -> dict[str, Any]:
    return {"side": "robot", "uid": "walker", **different}


def test_without_a_served_or_used_name_there_is_no_relay() -> None:
    assert parse(given()).relay_plan() is None


def test_each_kind_of_name_is_read() -> None:
    plan = parse(given(**ACTION, **SWITCH, **{
        "action.follow.accept": "Holder", "action.follow.hot": ["robot"], "action.follow.hold_for_ms": 3000.0,
        "services": ["plan"], "service.plan.name": "/plan", "service.plan.type": "nav_msgs/srv/GetPlan",
        "service.plan.mode": "Idempotent", "service.plan.core": True, "service.plan.node": "planner",
        "used_services": ["lamp"], "used_service.lamp.name": "/lamp", "used_service.lamp.type": "std_srvs/srv/SetBool",
        "used_service.lamp.timeout_ms": 500.0,
        "used_actions": ["dock"], "used_action.dock.name": "/dock", "used_action.dock.of_cloud": True,
        "used_action.dock.type": "test_msgs/action/Fibonacci", "used_action.dock.cancel_after_ms": 0.0,
        "cancel_deadline_ms": 1500.0, "prepare_deadline_ms": 4000.0, "lease_ms": 300.0,
    })).relay_plan()  # fmt: skip
    assert plan is not None
    fibonacci = "test_msgs/action/Fibonacci"
    assert plan.actions == (
        ActionSpec("/follow_path", fibonacci, OnSwitch.RESEND, accept=Accept.HOLDER, hold_for_s=3.0, hot=(Site.ROBOT,)),
    )
    planner = ServiceSpec("/plan", "nav_msgs/srv/GetPlan", "planner", ServiceMode.IDEMPOTENT, core=True)
    assert plan.services == (planner,)
    assert plan.used_services == (UsedService("/lamp", "std_srvs/srv/SetBool", timeout_s=0.5),)
    assert plan.used_actions == (UsedAction("/dock", fibonacci, cancel_after_s=0.0, of_cloud=True),)
    assert (plan.cancel_deadline_s, plan.prepare_deadline_s, plan.lease_s) == (1.5, 4.0, 0.3)


@pytest.mark.parametrize(
    ("different", "message"),
    [
        ({}, "action.follow.on_switch: must be given"),
        ({**SWITCH, "action.follow.type": "test_msgs/srv/Empty"}, "action.follow.type: .* has a form"),
        ({**SWITCH, "action.follow.hot": ["moon"]}, "action.follow.hot: 'moon'"),
        ({**SWITCH, "action.follow.mirror": True}, "action.follow.mirror: must be false"),
        ({**SWITCH, "action.follow.name": "follow"}, "action.follow.name"),
    ],
)
def test_what_cannot_work_is_named(different: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        parse(given(**{**ACTION, **different}))


@pytest.mark.parametrize(
    ("full", "member"),
    [
        ("/offload/cloud/pod_wheelchair_planner_5d9f8_x2x9z/make_plan", "pod_wheelchair_planner_5d9f8_x2x9z"),
        ("/offload/cloud/pod_a/make_plan/other", None),
        ("/offload/cloud/pod_a/pod_b/make_plan", None),
        ("/offload/cloud/make_plan", None),
        ("/offload/robot/pod_a/make_plan", None),
        ("/offload/cloud/pod_/make_plan", None),
        ("/offload/cloud/pod_../make_plan", None),
    ],
)
def test_a_pod_of_a_pool_is_known_by_the_private_name_that_it_serves(full: str, member: str | None) -> None:
    assert member_in(full, "/make_plan") == member
