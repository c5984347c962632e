"""Writes a line for each text on a topic: `python -m tests.ros.agent.reader DOMAIN TOPIC DURABILITY`."""

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(domain: int, topic: str, durability: str) -> None:
    rclpy.init(domain_id=domain)
    node = rclpy.create_node("reader")
    qos = QoSProfile(depth=10, durability=DurabilityPolicy[durability])
    node.create_subscription(String, topic, lambda message: say(message.data), qos)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], sys.argv[3])
