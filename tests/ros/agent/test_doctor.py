"""`robot-offload-agent doctor` in a real graph: somebody publishes, manages and waits as Nav2 does by default."""

import json
import subprocess
import sys
from pathlib import Path

import yaml

DOMAIN = 78
PARAMETERS = {
    "side": "robot",
    "uid": "doctor-1",
    "domain_id": DOMAIN,
    "link": {"type": "ros"},
    "nodes": ["controller_server"],
    "outputs": ["cmd_vel"],
    "output": {
        "cmd_vel": {
            "topic": "/cmd_vel",
            "type": "std_msgs/msg/String",
            "robot_topic": "/offload/robot/cmd_vel",
            "cloud_topic": "/offload/cloud/cmd_vel",
        }
    },
}
NAV2 = """
import rclpy
from lifecycle_msgs.srv import ChangeState
from std_msgs.msg import String
from std_srvs.srv import Trigger
rclpy.init(args=[], domain_id=int(__import__("sys").argv[1]))
server = rclpy.create_node("controller_server")
server.create_publisher(String, "/bond", 1)
server.create_service(Trigger, "/clear_costmap", lambda _, answer: answer)
server.create_client(Trigger, "/reload_map")
manager = rclpy.create_node("lifecycle_manager_navigation")
manager.create_client(ChangeState, "/controller_server/change_state")
navigator = rclpy.create_node("bt_navigator")
navigator.declare_parameter("default_server_timeout", 20)
teleop = rclpy.create_node("teleop")
teleop.create_publisher(String, "/cmd_vel", 1)
executor = rclpy.executors.SingleThreadedExecutor()
for node in (server, manager, navigator, teleop):
    executor.add_node(node)
print("up", flush=True)
executor.spin()
"""


def test_the_habits_of_nav2_that_would_bite_are_found_in_a_real_graph(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": PARAMETERS}}))
    doctor = [str(Path(sys.executable).with_name("robot-offload-agent")), "doctor", "--json", "--params", str(file)]
    with subprocess.Popen([sys.executable, "-c", NAV2, str(DOMAIN)], stdout=subprocess.PIPE, text=True) as nav2:
        assert nav2.stdout is not None
        assert nav2.stdout.readline() == "up\n"
        done = subprocess.run(doctor, capture_output=True, text=True, timeout=180, check=False)
        nav2.kill()
    findings = json.loads(done.stdout)
    found = {one["check"]: one for one in findings}
    undeclared = "\n".join(f"{one['message']} {one['step']}" for one in findings if one["check"] == "Undeclared")
    assert "publishes /bond" in undeclared
    assert "services: [{name: /clear_costmap, type: std_srvs/srv/Trigger}]" in undeclared
    assert "uses: {services: [{name: /reload_map, type: std_srvs/srv/Trigger}]}" in undeclared
    assert "/teleop" in found["SecondPublisher"]["message"]
    assert "/lifecycle_manager_navigation" in found["SecondLifecycleManager"]["message"]
    assert "/controller_server" in found["Bonds"]["message"]
    assert "default_server_timeout: 340" in found["ServerTimeout"]["step"]
    assert found["Nodes"]["level"] == found["MessageTypes"]["level"] == "ok"
    assert done.returncode == 1
