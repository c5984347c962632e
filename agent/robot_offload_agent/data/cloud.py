"""The shell of the cloud's data process: the replicas' topics, and those of consumers in the cloud."""

from __future__ import annotations

from functools import partial
from typing import Any

from robot_offload_agent.data.process import DataShell, plan, start
from robot_offload_agent.errors import StartError
from robot_offload_agent.ros import raw
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.collector import rivals
from robot_offload_core.data.cloud import CloudDataProcess


class CloudDataShell(DataShell):
    """The cloud's data process in its shell."""

    process: CloudDataProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        self.process = CloudDataProcess(plan(configuration, {}), self)
        self.declared_types = {i.name: i["type"] for i in configuration.inputs if i["type"] != "auto"}
        self.publishers: dict[str, Any] = {}
        self.published_types: dict[str, str] = {}
        self.inputs = {i.name: i for i in configuration.inputs}
        self.outputs = [
            raw.RawSubscription(self.node, o["cloud_topic"], o, False, raw.stamped(partial(self.leave, index)))
            for index, o in enumerate(configuration.outputs)
        ]
        self.twins = [rivals.Twins(self.node.get_fully_qualified_name()) for _ in configuration.outputs]
        self.fills: dict[int, Any] = {}
        self.shared = {
            index: raw.RawSubscription(self.node, o["topic"], o, False, partial(self.process.hear_others, index))
            for index, o in enumerate(configuration.outputs)
            if index in self.process.loops
        }
        self.watched = [
            raw.RawSubscription(self.node, i["topic"], i, i["latched"], partial(self.watch, i.name))
            for i in (() if self.carried else configuration.inputs)
            if i["max_age_ms"] > 0
        ]

    def leave(self, index: int, payload: bytes, published_s: float | None) -> None:
        """Take a message of a replica, on the ROS thread."""
        self.look_who_is_heard()
        self.process.leave(index, payload, published_s)

    def watch(self, name: str, payload: bytes) -> None:
        """Take an input that arrived by itself (DDS transports)."""
        del payload
        self.process.watch(name)

    def publish_output(self, index: int, payload: Any) -> None:
        """Publish to consumers in the cloud, once the type is known."""
        output = self.configuration.outputs[index]
        key = f"public {output.name}"
        if key not in self.publishers:
            name = self.outputs[index].type_name or self.input_types().get(output.name, "")
            if not name:
                return
            qos = raw.offered_qos(self.node, output, output["cloud_topic"])
            qos = qos or raw.publication_qos(output, output["durability"] == "transient_local")
            self.publishers[key] = raw.make_publisher(self.node, output["topic"], name, qos)
        self.publishers[key].publish(payload)

    def fill(self, index: int, payload: Any) -> None:
        """Publish on the private topic of a shared output's replica."""
        if index in self.fills:
            self.fills[index].publish(payload)

    def _look_for_twins(self) -> None:
        """Record outputs whose private topic several processes publish here."""
        for twins, output in zip(self.twins, self.configuration.outputs, strict=True):
            topic = output["cloud_topic"]
            found = [raw.endpoint(info) for info in self.node.get_publishers_info_by_topic(topic)]
            self.process.note(f"twins {output.name}", rivals.twins_problem(topic, twins.look(found, now_s())))

    def _resolve_shared(self) -> None:
        """Subscribe to the public topics of shared outputs; create the publishers of their private ones."""
        for index, heard in self.shared.items():
            heard.resolve()
            output = self.configuration.outputs[index]
            found = {raw.endpoint(info).node for info in self.node.get_publishers_info_by_topic(output["topic"])}
            self.process.look_at_frames(index, found - {"", self.node.get_fully_qualified_name()})
            name = self.outputs[index].type_name or heard.type_name
            if name and index not in self.fills:
                qos = raw.publication_qos(output, output["durability"] == "transient_local")
                self.fills[index] = raw.make_publisher(self.node, output["cloud_topic"], name, qos)
                self.process.repeat_others(index)

    def publish_input(self, name: str, payload: Any) -> bool:
        """Publish to the replicas; return False while the input's type is not known."""
        publisher = self.publishers.get(name)
        if publisher is not None:
            publisher.publish(payload)
        return publisher is not None

    def input_type(self, name: str) -> str:
        """Return the type under which an input is published, with its hash here; "" if it is not published yet."""
        return self.published_types.get(name, "")

    def input_types(self) -> dict[str, str]:
        """Return the names of the types of the inputs: as declared, else as the robot reports now."""
        said = {name: of.partition(" ")[0] for name, of in self.process.known_types.items()}
        return {**said, **self.declared_types}

    def resolve(self) -> bool:
        """Make publishers of inputs whose type is known; subscribe to outputs that are published."""
        resolved = []
        for subscription in [*self.outputs, *self.watched]:
            resolved.append(subscription.resolve())
            self.process.note(f"output {subscription.spec.name}", subscription.problem)
        self._look_for_twins()
        self._resolve_shared()
        types = self.input_types()
        for name, spec in self.inputs.items() if self.carried else ():
            if name not in types or self._publishes(name, types[name]):
                continue
            try:
                publisher = raw.make_publisher(
                    self.node, spec["topic"], types[name], raw.publication_qos(spec, spec["latched"])
                )
            except StartError as error:
                self.process.note(f"input {name}", ("TypeMissing", str(error)))
                continue
            for value in self.process.latched.get(name, ()):
                publisher.publish(value)
            self.publishers[name] = publisher
            self.published_types[name] = raw.named_type(types[name], raw.own_type_hash(self.node, spec["topic"]))
            self.process.note(f"input {name}", None)
        return all(resolved) and (not self.carried or self.publishers.keys() >= self.inputs.keys())

    def _publishes(self, name: str, type_name: str) -> bool:
        """Return whether an input is published under its type; remove a publisher of another type."""
        if name not in self.publishers:
            return False
        if self.published_types[name].partition(" ")[0] == type_name:
            topic = self.inputs[name]["topic"]
            self.published_types[name] = raw.named_type(type_name, raw.own_type_hash(self.node, topic))
            return True
        del self.published_types[name]
        self.node.destroy_publisher(self.publishers.pop(name))
        return False

    def on_room(self, channel: str) -> None:
        """Do nothing: the cloud's messages do not wait."""

    def types(self) -> dict[str, str]:
        """Return the types of the outputs that have been found in the graph."""
        return {s.spec.name: raw.named_type(s.type_name, s.type_hash) for s in self.outputs if s.type_name}


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, CloudDataShell)
