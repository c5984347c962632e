"""A lifecycle node that serves an action and a service of a package made on the spot; run by its path, as a user's is.

While it is Active it publishes `producer.PID#sequence` on /command and digs: a spoonful each 20 ms, as many as the goal
has depths. It knows its private names by its own: the tests give it no remappings but those of the node and /command.
"""

import contextlib
import os

import rclpy
from made_on_the_spot.action import Dig
from made_on_the_spot.srv import Ask
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.task import Future
from std_msgs.msg import Header


class Digging(LifecycleNode):
    """See the module."""

    def __init__(self) -> None:
        super().__init__("walker", enable_rosout=False)
        self.producer = f"{self.get_name()}.{os.getpid()}"
        self.sequence = 0
        self.goals: dict[bytes, tuple[ServerGoalHandle, Future, list[float]]] = {}
        self.command = self.create_lifecycle_publisher(Header, "/command", 10)
        side = "cloud" if self.get_name().startswith("remote_") else "robot"
        self.server = ActionServer(
            self, Dig, f"/offload/{side}/dig", self.execute,
            goal_callback=lambda _: GoalResponse.ACCEPT if self.command.is_activated else GoalResponse.REJECT,
            handle_accepted_callback=self.accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        self.create_service(Ask, f"/offload/{side}/why", self.why)
        self.create_timer(1.0 / self.declare_parameter("rate_hz", 20.0).value, self.tell)
        self.create_timer(0.02, self.dig)

    def accepted(self, goal: ServerGoalHandle) -> None:
        self.goals[bytes(goal.goal_id.uuid)] = (goal, Future(), [])
        goal.execute()

    async def execute(self, goal: ServerGoalHandle) -> Dig.Result:
        _, ended, _ = self.goals[bytes(goal.goal_id.uuid)]
        await ended
        return Dig.Result(done=f"{os.getpid()} to {goal.request.depths[-1]}")

    def dig(self) -> None:
        for goal, ended, dug in self.goals.values():
            if ended.done():
                continue
            dug.append(goal.request.depths[len(dug)])
            goal.publish_feedback(Dig.Feedback(spoonfuls=len(dug), depth=dug[-1]))
            if len(dug) == len(goal.request.depths):
                goal.succeed()
                ended.set_result(None)

    def why(self, request: Ask.Request, response: Ask.Response) -> Ask.Response:
        response.success, response.answer = True, f"{request.question}: {os.getpid()}"
        return response

    def tell(self) -> None:
        if self.command.is_activated:
            self.sequence += 1
            stamp = self.get_clock().now().to_msg()
            self.command.publish(Header(stamp=stamp, frame_id=f"{self.producer}#{self.sequence}"))


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    executor.add_node(Digging())
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
