"""The figures of the whole robot, from logs and reports."""

from __future__ import annotations

from robot_offload.api.files import load
from robot_offload_lab.bench.sedia import SPEC, Changeover, changeovers, figures, longer, table

GROUP = ["amcl", "planner_server"]
LOG = [
    "23:04:05.512 INFO robot.robot: The link is good placement=robot phase=ToCloud epoch=3 reason=LinkGood",
    "23:04:05.540 INFO cloud.process: Node amcl: inactive -> active reason=StateChanged",
    "23:04:05.562 INFO cloud.process: Node planner_server: inactive -> active reason=StateChanged",
    "23:04:05.738 INFO robot.process: Node amcl: active -> inactive reason=StateChanged",
    "23:04:21.126 INFO robot.robot: No heartbeat placement=robot phase=Takeover epoch=5 reason=HeartbeatLost",
    "23:04:21.130 INFO robot.process: Node planner_server: inactive -> active reason=StateChanged",
    "23:04:21.131 INFO robot.process: Node lidar: inactive -> active reason=StateChanged",
    "23:04:21.156 INFO robot.process: Node amcl: inactive -> active reason=StateChanged",
    "23:04:33.000 INFO robot.robot: The link is good placement=robot phase=ToCloud epoch=5 reason=LinkGood",
    "23:04:33.020 INFO cloud.process: Node amcl: inactive -> active reason=StateChanged",
    "no line of ours",
]
REPORT = {
    "switches": [{"gap_ms": {"/cmd_vel_nav": 120.0}}, {"gap_ms": {"/cmd_vel_nav": None}}],
    "goals": [{"ending": "succeeded", "restarts": 2}, {"ending": "on the way", "restarts": 1}],
    "placement_share": {"cloud": 0.7},
    "processor": {"robot-navigation": 9.0, "robot-agent": 20.0, "cloud-navigation": 15.0},
}


def test_a_change_ends_when_the_last_node_of_the_group_is_active_and_one_that_never_does_does_not_count() -> None:
    to_cloud, to_robot = changeovers(LOG, GROUP)
    assert to_cloud == Changeover("cloud", False, to_cloud.ready_ms)
    assert round(to_cloud.ready_ms) == 50
    assert to_robot == Changeover("robot", True, to_robot.ready_ms)
    assert round(to_robot.ready_ms) == 30


def test_the_lines_of_two_logs_are_read_in_the_order_of_time() -> None:
    assert len(changeovers(sorted(LOG, key=lambda line: "cloud." in line), GROUP)) == 2


def test_a_goal_on_the_way_is_not_lost_and_the_page_has_every_program() -> None:
    alone = {"processor": {"robot-navigation": 18.0, "robot-agent": 12.0}}
    found = figures(REPORT, alone, changeovers(LOG, GROUP))
    assert (found["goals"], found["goals_succeeded"], found["goals_lost"], found["restarts"]) == (2, 1, 0, 3)
    assert found["command_gap_ms"] == {"n": 1, "p50": 120, "max": 120}
    page = table(found, "2026-11-22", "2 cores")
    assert "| robot-navigation | 9.0 | 18.0 |" in page
    assert "| cloud-navigation | 15.0 | \N{EN DASH} |" in page


def test_the_patrol_of_the_bench_has_a_goal_all_the_time() -> None:
    [before, after] = [
        next(node.run for node in offload.spec.nodes if node.name == "waypoint_follower")
        for offload in (load(SPEC), longer(load(SPEC)))
    ]
    assert before is not None
    assert after is not None
    assert len(after.parameters["waypoints"]) == 4 * len(before.parameters["waypoints"])
