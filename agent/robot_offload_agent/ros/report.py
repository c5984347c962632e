"""The three lifecycle nodes of a side and everything they publish."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter as NodeParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header, Int32, String

from robot_offload_agent.ros import context, services
from robot_offload_agent.ros.live import Live
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.offer import RUN_TIME
from robot_offload_agent.settings.override import WORDS, Override
from robot_offload_agent.settings.parameter import Parameter
from robot_offload_agent.settings.parameters import GENERAL, Configuration
from robot_offload_core.control.nodes.managed_nodes import Node as GuardedNode
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Health
from robot_offload_core.words.beats import Beat
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.messages import PulseStatus

log = logging.getLogger(__name__)

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEAT_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
Problem = tuple[str, str]
LISTENED_S = 0.5
"""Interval of the checks for subscribers to the beats."""
SHOWN_S = 0.1
"""Interval at which a beat is published to subscribers: each costs as much as a decision."""


def describe(parameter: Parameter, read_only: bool = True) -> ParameterDescriptor:
    """Return what `ros2 param describe` shows."""
    text = parameter.text + (f" ({', '.join(parameter.choices)})" if parameter.choices else "")
    descriptor = ParameterDescriptor(description=text, read_only=read_only)
    if parameter.low is not None and parameter.high is not None:
        if parameter.type is float:
            descriptor.floating_point_range = [FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
        else:
            span = IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high), step=1)
            descriptor.integer_range = [span]
    return descriptor


class Report:
    """network_monitor, cloud_switcher and guardian (remote_... in the cloud), active from the start."""

    def __init__(self, configuration: Configuration) -> None:
        self.configuration = configuration
        self.side = configuration.side
        self.showing = False
        prefix = "" if self.side is Site.ROBOT else "remote_"
        self.monitor, self.switcher, self.guardian = (
            self._make(f"{prefix}{name}") for name in ("network_monitor", "cloud_switcher", "guardian")
        )
        self.nodes: list[Node] = [self.monitor, self.switcher, self.guardian]
        self.problems: dict[str, Problem] = {}
        self.network_status_value: int | None = None
        self.network_status = self.monitor.create_lifecycle_publisher(Int32, f"/{prefix}network_status", LATCHED)
        self.diagnostics = self.switcher.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.placement = self.availability = self.live = None
        if self.side is Site.ROBOT:
            self.placement = self.switcher.create_publisher(String, "/offload/placement", LATCHED)
            self.live = Live(self.switcher)
            if any(output["of_cloud"] for output in configuration.outputs):
                self.availability = self.switcher.create_publisher(DiagnosticArray, "/offload/available", LATCHED)
        # On DDS transports the beats themselves travel on these topics; otherwise received beats are mirrored.
        heard = "/connectivity_test_remote" if self.side is Site.ROBOT else "/connectivity_test_local"
        self.mirror = None
        self.is_listened_to, self.listened_due_s, self.shown_due_s = False, 0.0, 0.0
        if configuration["link.type"] == "zenoh":
            self.mirror = self.monitor.create_lifecycle_publisher(Header, heard, BEAT_QOS)
        for node in (self.monitor, self.switcher, self.guardian):
            node.trigger_configure()
            node.trigger_activate()

    def _make(self, name: str) -> LifecycleNode:
        has_parameters = name.endswith("cloud_switcher")
        node = LifecycleNode(
            name,
            namespace=self.configuration["namespace"],
            use_global_arguments=False,
            start_parameter_services=has_parameters,
            enable_rosout=False,
            parameter_overrides=[*context.UNDESCRIBED],
        )
        if has_parameters:
            for key, parameter in GENERAL.items():
                # What the cloud may change is shown as it is; `_guarded` ensures that no other program sets it.
                fixed = key not in RUN_TIME or self.side is Site.CLOUD
                node.declare_parameter(key, self.configuration[key], describe(parameter, fixed))
            node.add_on_set_parameters_callback(self._guarded)
        return node

    def _guarded(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Refuse to set the resource's settings by hand."""
        names = [p.name for p in parameters if p.name in RUN_TIME]
        if names and not self.showing:
            reason = f"{', '.join(names)}: comes from the resource; change it there, or set override to move the robot"
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def show_settings(self, configuration: Configuration) -> None:
        """Show the settings in force as parameters, from any thread."""
        values = [NodeParameter(name, value=configuration[name]) for name in RUN_TIME]

        def show() -> None:
            self.showing = True
            self.switcher.set_parameters(values)
            self.showing = False

        executor = self.switcher.executor
        if executor is None:
            show()  # nothing is spun yet
        else:
            executor.create_task(show)

    def switcher_names(self) -> Mapping[str, Site]:
        """Return the switch services that this side serves: on a shared graph each name once."""
        if self.side is Site.CLOUD:
            return services.CLOUD
        return services.LOCAL if self.configuration["link.type"] == "ros" else {**services.LOCAL, **services.CLOUD}

    def declare_override(self, override: Override, changed: Callable[[], None]) -> None:
        """Declare the one parameter that can be set at run time: the maintenance override, with its duration."""
        node = self.switcher
        words = ", ".join(WORDS)
        node.declare_parameter(
            "override", override.word, ParameterDescriptor(description=f"maintenance override ({words})")
        )
        node.declare_parameter(
            "override_for_s", 0.0, ParameterDescriptor(description="expiry of the next override, s; 0: none")
        )

        def given_for_s(parameters: Iterable[Any]) -> float:
            """Return the expiry that is set together with the override or was set before."""
            given = [p.value for p in parameters if p.name == "override_for_s"]
            return float(given[-1] if given else node.get_parameter("override_for_s").value)

        def on_set(parameters: Sequence[Any]) -> SetParametersResult:
            for parameter in parameters:
                if parameter.name == "override" and parameter.value not in WORDS:
                    return SetParametersResult(successful=False, reason=f"override must be one of {words}")
            for parameter in parameters:
                if parameter.name == "override":
                    try:
                        override.set(parameter.value, given_for_s(parameters))
                    except OSError as error:
                        return SetParametersResult(successful=False, reason=f"cannot be kept: {error}")
                    changed()
            return SetParametersResult(successful=True)

        node.add_on_set_parameters_callback(on_set)

    def show_override(self, word: str) -> None:
        """Set the parameter as the user would, from any thread."""
        node = self.switcher
        if node.executor is not None:
            node.executor.create_task(node.set_parameters, [NodeParameter("override", value=word)])

    # -- publishing ---------------------------------------------------------------------------------------------------

    def note(self, key: str, problem: Problem | None) -> None:
        """Keep or clear a problem; log each new one once."""
        if problem is None:
            self.problems.pop(key, None)
        elif self.problems.get(key) != problem:
            self.problems[key] = problem
            log.warning("%s reason=%s", problem[1], problem[0])

    def publish_network_status(self, value: int) -> None:
        """Publish 1 if the link sustains the cloud, else 0."""
        self.network_status.publish(Int32(data=value))

    def publish_placement(self, body: str) -> None:
        """Publish the latched placement (JSON)."""
        if self.placement is not None:
            self.placement.publish(String(data=body))

    def publish_available(self, statements: Iterable[Available]) -> None:
        """Publish the latched statements on the nodes with placement Cloud: a status for each, OK while available.

        The name of a status is the node's; the value `reason` is a word, empty while the node is available.
        """
        if self.availability is None:
            return
        array = DiagnosticArray()
        array.header.stamp = self.switcher.get_clock().now().to_msg()
        for one in statements:
            level = DiagnosticStatus.ERROR if one.reason else DiagnosticStatus.OK
            values = [KeyValue(key="reason", value=one.reason.value if one.reason else "")]
            array.status.append(
                DiagnosticStatus(
                    name=one.node, hardware_id=self._who(), level=level, message=one.message, values=values
                )
            )
        self.availability.publish(array)

    def mirror_beat(self, text: str, beat: Beat) -> None:
        """Publish a received beat, for people and other monitors: ten a second."""
        now = now_s()
        if self.mirror is None or now < self.shown_due_s:
            return
        self.shown_due_s = now + SHOWN_S
        if now >= self.listened_due_s:
            self.listened_due_s = now + LISTENED_S
            self.is_listened_to = self.mirror.get_subscription_count() > 0
        if not self.is_listened_to:
            return
        message = Header(frame_id=text)
        wall_ns = (beat.sent_us + beat.wall_us) * 1000
        message.stamp.sec, message.stamp.nanosec = divmod(max(0, wall_ns), 1_000_000_000)
        self.mirror.publish(message)

    def publish_diagnostics(
        self,
        link: Health | None,
        pulse: PulseStatus | None,
        placement: Mapping[str, str],
        nodes: Iterable[GuardedNode],
        counters: Mapping[str, int],
        problems: Iterable[Problem],
    ) -> None:
        """Publish one /diagnostics message: link, placement, every node, counters, problems."""
        statuses = [self._link(link, pulse), self._placement(placement)]
        statuses += [self._node(node) for node in nodes]
        found = [*self.problems.values(), *problems]
        level = DiagnosticStatus.WARN if found else DiagnosticStatus.OK
        message = "; ".join(text for _, text in found) or "No problems"
        values = {**{name: str(count) for name, count in counters.items()}, **dict(found)}
        statuses.append(self._status("data", level, message, values))
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self.switcher.get_clock().now().to_msg()
        self.diagnostics.publish(array)

    def _link(self, link: Health | None, pulse: PulseStatus | None) -> DiagnosticStatus:
        values = {key: "" if value is None else str(value) for key, value in asdict(link).items()} if link else {}
        if pulse is None:
            return self._status("link", DiagnosticStatus.ERROR, "The pulse process has not reported", values)
        values.update(endpoint=pulse.endpoint, fallback=str(pulse.fallback), sessions=str(pulse.sessions))
        values.update(cause=pulse.cause)
        values.update({f"garbage.{reason}": str(count) for reason, count in pulse.garbage})
        well = pulse.connected and not pulse.fallback and not pulse.cause
        level = DiagnosticStatus.OK if well else DiagnosticStatus.WARN
        return self._status(
            "link", level, pulse.message or ("Connected" if pulse.connected else "Not connected"), values
        )

    def _placement(self, placement: Mapping[str, str]) -> DiagnosticStatus:
        return self._status("placement", DiagnosticStatus.OK, placement["message"], placement)

    def _node(self, node: GuardedNode) -> DiagnosticStatus:
        level = DiagnosticStatus.OK
        if node.gave_up or node.state is State.UNKNOWN:
            level = DiagnosticStatus.ERROR if node.spec.core else DiagnosticStatus.WARN
        message = node.gave_up or node.state.value
        return self._status(f"node {node.spec.name}", level, message, {"failures": str(node.failures)})

    def _status(self, name: str, level: bytes, message: str, values: Mapping[str, str]) -> DiagnosticStatus:
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        return DiagnosticStatus(
            name=f"robot_offload {self.side.value}: {name}", hardware_id=self._who(), level=level, message=message,
            values=pairs,
        )  # fmt: skip

    def _who(self) -> str:
        return self.configuration["robot_name"] or str(self.configuration["uid"])
