"""Three duplicated nodes in one process, each of which does everything that a node can do to others.

`walker` is managed and acts while it is Active (Warm), `hot` is managed and is kept Active, `plain` has no lifecycle.
What they say, ask and write carries their names; private names are those that the agents expect, so they need no
remappings.
"""

import contextlib
import os
import sys
from pathlib import Path

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header
from test_msgs.srv import BasicTypes

SIDE = "cloud" if any("remote_" in word for word in sys.argv) else "robot"
PREFIX = "remote_" if SIDE == "cloud" else ""
OUTPUTS = {"walker": "command", "hot": "hot_declared", "plain": "plain_declared"}
WRITTEN = "written-by-{side}-{kind}"


class Doing:
    """Everything that one of them does."""

    def __init__(self, node: Node, kind: str) -> None:
        self.node, self.kind, self.count = node, kind, 0
        self.declared = node.create_publisher(Header, f"/offload/{SIDE}/{OUTPUTS[kind]}", 10)
        self.undeclared = node.create_publisher(Header, "/undeclared", 10)
        node.declare_parameter("count", 0)
        for name in (f"/offload/{SIDE}/{kind}_serves", f"/{kind}_serves_undeclared"):
            node.create_service(BasicTypes, name, self.serve)
        names = (f"/offload/{SIDE}/uses", "/uses_undeclared")
        self.clients = [node.create_client(BasicTypes, name) for name in names]
        node.create_timer(0.05, self.act)

    def act(self) -> None:
        if isinstance(self.node, Managed) and not self.node.acting:
            return
        self.count += 1
        named = f"{PREFIX}{self.kind}.{os.getpid()}#{self.count}"
        self.declared.publish(Header(stamp=self.node.get_clock().now().to_msg(), frame_id=named))
        self.undeclared.publish(Header(frame_id=f"{SIDE} {self.kind}"))
        if self.count % 10:
            return
        self.node.get_logger().info("acts")
        self.node.set_parameters([Parameter("count", value=self.count)])
        (Path(os.environ["ROS_LOG_DIR"]) / WRITTEN.format(side=SIDE, kind=self.kind)).touch()
        for client in self.clients:
            if client.service_is_ready():
                client.call_async(BasicTypes.Request(string_value=f"{SIDE} {self.kind}"))

    def serve(self, _request: BasicTypes.Request, response: BasicTypes.Response) -> BasicTypes.Response:
        response.string_value = SIDE
        return response


class Managed(LifecycleNode):  # type: ignore[misc]
    """A managed node."""

    def __init__(self, kind: str) -> None:
        super().__init__(f"{PREFIX}{kind}")
        self.acting = False
        self.doing = Doing(self, kind)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.acting = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.acting = False
        return super().on_deactivate(state)


class Plain(Node):  # type: ignore[misc]
    """A node without a lifecycle."""

    def __init__(self) -> None:
        super().__init__(f"{PREFIX}plain")
        self.doing = Doing(self, "plain")


def main() -> None:
    rclpy.init(args=[])  # the names are made here
    executor = SingleThreadedExecutor()
    for node in (Managed("walker"), Managed("hot"), Plain()):
        executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
