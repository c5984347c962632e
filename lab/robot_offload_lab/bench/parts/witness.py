"""A witness in one ROS domain: writes down placements, lifecycle transitions and mirrored beats; asks for switches.

`python -m robot_offload_lab.bench.parts.witness FILE --node NAME`. Standard input takes `{"ask": "robot" | "cloud"}`, a
line each: the switch is asked for through the services, as a person would. Standard output repeats everything but the
beats as it comes, for the bench to follow.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import sys
from pathlib import Path
from typing import Any, Final

import rclpy
from lifecycle_msgs.msg import TransitionEvent
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from robot_offload_lab.bench.observed import LINES, Answered, BeatHeard, Observation, Transition
from robot_offload_lab.bench.parts import node
from robot_offload_lab.judge import translate
from robot_offload_lab.wire.loop import steady_s

ATTEND_S: Final = 0.01
SERVICES: Final = {"robot": "guardian_activate_local_nodes", "cloud": "guardian_activate_cloud_nodes"}
LATCHED: Final = QoSProfile(
    depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
BEATS: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Witness:
    """Subscriptions and service clients around one file."""

    def __init__(self, path: Path, watched: str, *, beats: bool) -> None:
        # Closed by the end of the process; line-buffered, so that nothing is lost with it.
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self._unread = b""
        self.node = rclpy.create_node("bench_witness")
        self.node.create_subscription(String, "/offload/placement", self._on_placement, LATCHED)
        if beats:
            self.node.create_subscription(Header, "/connectivity_test_remote", self._on_beat, BEATS)
        self.node.create_subscription(TransitionEvent, f"/{watched}/transition_event", self._on_transition, 10)
        self._services = {site: self.node.create_client(Trigger, name) for site, name in SERVICES.items()}

    def attend(self) -> None:
        """Carry out the commands that have come."""
        if not select.select([sys.stdin], [], [], 0)[0]:
            return
        *lines, self._unread = (self._unread + os.read(sys.stdin.fileno(), 4096)).split(b"\n")
        for line in lines:
            self._ask(json.loads(line)["ask"])

    def _ask(self, site: str) -> None:
        asked_s = steady_s()
        if not self._services[site].service_is_ready():
            self._take(Answered(asked_s, asked_s, site, False, "the service is not there"))
            return

        def done(future: Any) -> None:
            answer = future.result()
            if answer is not None:
                self._take(Answered(steady_s(), asked_s, site, answer.success, answer.message))

        self._services[site].call_async(Trigger.Request()).add_done_callback(done)

    def _on_placement(self, message: String) -> None:
        announcement = translate.placement(steady_s(), message.data)
        if announcement is not None:
            self._take(announcement)

    def _on_transition(self, message: TransitionEvent) -> None:
        self._take(Transition(steady_s(), message.goal_state.label))

    def _on_beat(self, message: Header) -> None:
        self._file.write(LINES.encode(BeatHeard(steady_s(), message.frame_id)) + "\n")

    def _take(self, observation: Observation) -> None:
        line = LINES.encode(observation) + "\n"
        self._file.write(line)
        sys.stdout.write(line)
        sys.stdout.flush()


def main() -> None:
    """Observe until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.witness", description=__doc__)
    parser.add_argument("file", type=Path, help="what to write")
    parser.add_argument("--node", required=True, help="the lifecycle node whose transitions are watched")
    parser.add_argument("--no-beats", action="store_true", help="leave the beats out: hearing them costs the agents")
    options = parser.parse_args()
    node.start()
    witness = Witness(options.file, options.node, beats=not options.no_beats)
    node.spin(witness.node, witness.attend, ATTEND_S)


if __name__ == "__main__":
    main()
