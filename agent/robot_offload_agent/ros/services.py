"""The four services of a switch by hand: each is a request `site = X` to the robot's machine."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from robot_offload_core.fence.token import Site

LOCAL = {"guardian_activate_local_nodes": Site.ROBOT, "guardian_deactivate_local_nodes": Site.CLOUD}
CLOUD = {"guardian_activate_cloud_nodes": Site.CLOUD, "guardian_deactivate_cloud_nodes": Site.ROBOT}


class SwitchServices:
    """Serves a set of the four names; answers come from the deciding thread. Keys count from 1."""

    def __init__(self, node: Node, names: Mapping[str, Site], ask: Callable[[Site, int], None]) -> None:
        self.ask = ask
        self.keys = itertools.count(1)
        self.waiting: dict[int, Future] = {}
        self.lock = threading.Lock()
        self.servers = [node.create_service(Trigger, name, self.handler(site)) for name, site in names.items()]
        self.node = node

    def handler(self, site: Site) -> Callable[[Any, Any], Any]:
        """Return a service callback that waits for the answer without blocking the executor."""

        async def handle(_request: Any, response: Any) -> Any:
            future = Future(executor=self.node.executor)
            key = next(self.keys)
            with self.lock:
                self.waiting[key] = future
            self.ask(site, key)
            response.success, response.message = await future
            return response

        return handle

    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Answer a call (deciding thread)."""
        with self.lock:
            future = self.waiting.pop(key, None)
        if future is not None and self.node.executor is not None:
            self.node.executor.create_task(future.set_result, (accepted, message))
