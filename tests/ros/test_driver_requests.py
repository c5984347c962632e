"""What the driver is asked for, when its threads let one request overtake another."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
import rclpy
import yaml
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

from robot_offload_agent.ros.managed_nodes import ManagedNodes
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.parameters import Configuration, load
from robot_offload_core.control.nodes import guardians
from robot_offload_core.words.events import Acting, Tick
from tests.ros.agent.ears import INHIBIT, Ear

pytestmark = pytest.mark.ros
DOMAIN = 70
PATIENCE_S = 60.0
SLOW_S = 0.3


@contextmanager
def driver(slow: bool) -> Iterator[list[bool]]:
    """Serves requests in parallel, those for `slow` later than the others; the list grows with each one served."""
    served: list[bool] = []
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Node("driver", context=context, enable_rosout=False, start_parameter_services=False)

    def serve(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        time.sleep(SLOW_S if request.data is slow else 0.0)
        served.append(request.data)
        response.success = True
        return response

    node.create_service(SetBool, INHIBIT, serve, callback_group=ReentrantCallbackGroup())
    executor = MultiThreadedExecutor(4, context=context)
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield served
    finally:
        executor.shutdown(timeout_sec=PATIENCE_S)
        thread.join(PATIENCE_S)
        node.destroy_node()
        rclpy.shutdown(context=context)


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    given = {"side": "robot", "uid": "driver-1", "link": {"type": "ros"}, "inhibit_service": INHIBIT}
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    return load(file)


@pytest.mark.parametrize("last", [True, False])
def test_a_request_that_was_overtaken_is_not_the_drivers_last_word(configuration: Configuration, last: bool) -> None:
    heard: queue.Queue[guardians.Event] = queue.Queue()
    with driver(slow=not last) as served, closing(Ear(DOMAIN, "agent")) as ear:
        nodes = ManagedNodes(configuration, ear.node, heard.put)
        guardian = guardians.start((), grace_s=1.0, has_driver=True)

        def step(event: guardians.Event) -> None:
            nonlocal guardian
            guardian, commands = guardians.step(guardian, event, now_s())
            for command in commands:
                nodes.carry_out(command)

        def until(holds: Callable[[], bool]) -> None:
            end_s = time.monotonic() + PATIENCE_S
            while not holds():
                assert time.monotonic() < end_s, f"served {served}"
                try:
                    step(heard.get(timeout=0.01))
                except queue.Empty:
                    step(Tick())

        assert nodes.inhibit is not None
        until(nodes.inhibit.service_is_ready)
        level = {True: Acting(True, in_charge=True, stop="a veto"), False: Acting(True, in_charge=True)}
        step(level[last])
        until(lambda: guardian.inhibited is last)
        served.clear()
        step(level[not last])
        step(level[last])
        until(lambda: (not last) in served and served[-1] is last)
