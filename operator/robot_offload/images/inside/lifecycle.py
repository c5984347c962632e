"""Asks a node in this image whether it is there or Active, or takes it to Active: lifecycle.py WHAT [NODE].

WHAT is `present`, `active` or `activate`; NODE is its full name, else ROBOT_OFFLOAD_NODE. Ends with 0 when it is so.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

# A plain client of a discovery server sees only what it talks to; this one must find a node by its name.
os.environ.setdefault("ROS_SUPER_CLIENT", "TRUE")

import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

NEXT = {
    State.PRIMARY_STATE_UNCONFIGURED: Transition.TRANSITION_CONFIGURE,
    State.PRIMARY_STATE_INACTIVE: Transition.TRANSITION_ACTIVATE,
}


class Asker:
    """A node of its own that asks another one, and gives up after some seconds."""

    def __init__(self, name: str, timeout_s: float) -> None:
        self.name = name
        self.deadline_s = time.monotonic() + timeout_s
        self.node = rclpy.create_node(f"robot_offload_lifecycle_{os.getpid()}", start_parameter_services=False)

    def left_s(self) -> float:
        """Return seconds until the deadline."""
        return max(0.0, self.deadline_s - time.monotonic())

    def present(self) -> bool:
        """Return whether the node shows up in ROS."""
        while self.left_s() > 0:
            names = [f"{space.rstrip('/')}/{name}" for name, space in self.node.get_node_names_and_namespaces()]
            if self.name in names:
                return True
            time.sleep(0.1)
        return False

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of one of the node's services, or None."""
        client = self.node.create_client(kind, f"{self.name}/{service}")
        if not client.wait_for_service(timeout_sec=self.left_s()):
            return None
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=self.left_s())
        return future.result() if future.done() else None

    def state(self) -> Any:
        """Return the node's lifecycle state, or None."""
        answer = self.call(GetState, "get_state", GetState.Request())
        return answer.current_state.id if answer else None

    def activate(self) -> bool:
        """Return whether the node reached Active, one transition after the other."""
        while self.left_s() > 0:
            state = self.state()
            if state == State.PRIMARY_STATE_ACTIVE:
                return True
            if state not in NEXT:
                time.sleep(0.1)
                continue
            request = ChangeState.Request(transition=Transition(id=NEXT[state]))
            answer = self.call(ChangeState, "change_state", request)
            if answer is not None and not answer.success:
                return False
        return False


def main() -> int:
    """Run one question."""
    what, name = sys.argv[1], (sys.argv[2] if len(sys.argv) > 2 else os.environ["ROBOT_OFFLOAD_NODE"])
    rclpy.init()
    asker = Asker(name, 60.0 if what == "activate" else 8.0)
    if what == "present":
        done = asker.present()
    elif what == "activate":
        done = asker.activate()
    else:
        done = asker.state() == State.PRIMARY_STATE_ACTIVE
    if not done:
        sys.stderr.write(f"{name} {'did not become active' if what == 'activate' else f'is not {what}'}\n")
    rclpy.shutdown()
    return 0 if done else 1


if __name__ == "__main__":
    sys.exit(main())
