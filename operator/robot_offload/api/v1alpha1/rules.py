"""The rules between fields that the API server judges by itself, in its own language (CEL).

Each says the same as a check of `checks` and refuses the same objects, only sooner: when the object is written. What
CEL cannot say at a bearable cost (an output of two nodes, topics that differ in underscores) only the checks know.

The text must hold for an object whose defaults the API server has filled in and from which it has dropped nulls; what
has no default may be missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1.model import yaml_name
from robot_offload.api.v1alpha1.nodes import RESERVED_VARIABLES
from robot_offload.api.v1alpha1.robotoffload import FAST_DDS
from robot_offload.api.v1alpha1.transport import BLOCKS, ONE_DOMAIN


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule of the CRD.

    Attributes:
        path: the object that it is about, e.g. `spec.nodes[]` for each node.
        reason: the reason of the check that says the same.
        rule: CEL; `self` is the object at `path`.
        message: what is wrong and what to write instead.
        field: the field of it that the message is shown with, as the check does; empty: the object itself.
    """

    path: str
    reason: str
    rule: str
    message: str
    field: str = ""

    def schema(self) -> dict[str, Any]:
        """The rule as it stands in `x-kubernetes-validations`."""
        where = {"fieldPath": f".{self.field}"} if self.field else {}
        return {"rule": self.rule, "message": self.message, **where}


def _milliseconds(duration: str) -> str:
    """CEL for a duration as a number of milliseconds, whether getMilliseconds() is the total or the part below 1 s."""
    return f"(duration({duration}).getSeconds() * 1000 + duration({duration}).getMilliseconds() % 1000)"


def _cel_list(words: tuple[str, ...]) -> str:
    return f"[{', '.join(repr(word) for word in words)}]"


_LOOP: Final = (
    "duration(self.latency.robotPeriod) + duration(self.latency.tolerance) - duration(self.latency.cloudPeriod)"
)
_BEAT: Final = "duration(self.heartbeatPeriod)"


def _blocks() -> Iterator[Rule]:
    for block, types in BLOCKS.items():
        yield Rule(
            "spec.transport",
            "WrongBlock",
            f"!has(self.{yaml_name(block)}) || self.type in {_cel_list(types)}",
            f"{yaml_name(block)} belongs to transport type {' or '.join(types)}; remove it or change type",
            yaml_name(block),
        )


_TRANSPORT: Final = (
    *_blocks(),
    Rule(
        "spec.transport",
        "NoPeers",
        "self.type != 'StaticPeers' || (has(self.staticPeers) && has(self.staticPeers.robot) && "
        "size(self.staticPeers.robot) > 0)",
        "transport type StaticPeers needs at least one address of the robot, as the cloud reaches it: add "
        "staticPeers.robot",
        "staticPeers",
    ),
    Rule(
        "spec.transport.zenoh",
        "SamePort",
        "self.pulsePort != self.dataPort",
        "pulsePort and dataPort are the same port; give the data session another one",
        "dataPort",
    ),
    Rule(
        "spec.transport.expose",
        "WrongExposure",
        "self.type == 'LoadBalancer' || !has(self.address)",
        "address belongs to type LoadBalancer; remove it or write type: LoadBalancer",
        "address",
    ),
    Rule(
        "spec.transport.expose",
        "WrongExposure",
        "self.type == 'LoadBalancer' || !has(self.loadBalancerClass)",
        "loadBalancerClass belongs to type LoadBalancer; remove it or write type: LoadBalancer",
        "loadBalancerClass",
    ),
    Rule(
        "spec.transport.expose",
        "WrongExposure",
        "self.type != 'ClusterIP' || !has(self.nodePorts)",
        "Services of type ClusterIP have no ports on the nodes; remove nodePorts or write type: NodePort",
        "nodePorts",
    ),
    Rule(
        "spec.transport.certificates",
        "TooLong",
        "duration(self.renewBefore) < duration(self.duration)",
        "renewBefore is not less than duration, so certificates would be renewed all the time; write for example a "
        "third of duration",
        "renewBefore",
    ),
)
_CLOUD: Final = (
    Rule(
        "spec",
        "DomainsDiffer",
        f"!(self.transport.type in {_cel_list(ONE_DOMAIN)}) || !has(self.cloud.domainID) || "
        "self.cloud.domainID == self.robot.domainID",
        f"transport types {' and '.join(ONE_DOMAIN)} join both sides in one domain, but the robot's is another one; "
        "remove domainID under spec.cloud",
        "cloud.domainID",
    ),
    Rule(
        "spec",
        "CloudRmw",
        f"(has(self.cloud.rmw) ? self.cloud.rmw : self.robot.rmw) in {_cel_list(FAST_DDS)}",
        "the cloud's middleware cannot find nodes through discovery servers, as a cluster needs it; write "
        f"rmw: {FAST_DDS[0]} under spec.cloud",
        "cloud.rmw",
    ),
    Rule(
        "spec.cloud.tolerations[]",
        "Contradiction",
        "self.operator != 'Exists' || !has(self.value) || self.value == ''",
        "operator Exists takes no value; remove it",
        "value",
    ),
    Rule(
        "spec.cloud.tolerations[]",
        "Required",
        "self.operator == 'Exists' || has(self.key)",
        "key is missing; give one or write operator: Exists",
        "key",
    ),
    Rule(
        "spec.cloud.tolerations[]",
        "Contradiction",
        "!has(self.tolerationSeconds) || (has(self.effect) && self.effect == 'NoExecute')",
        "tolerationSeconds counts for effect NoExecute only; remove it or add that",
        "tolerationSeconds",
    ),
)
_NODES: Final = (
    Rule(
        "spec.topics.toCloud[]",
        "Contradiction",
        "!self.latched || !has(self.qos) || !has(self.qos.durability) || self.qos.durability != 'Volatile'",
        "durability Volatile keeps no last value, but the topic is latched; write TransientLocal or latched: false",
        "qos.durability",
    ),
    Rule(
        "spec.nodes[]",
        "NotManaged",
        "self.placement != 'Duplicated' || self.lifecycle",
        "a Duplicated node must be a managed (lifecycle) node: only those can be put to sleep; write lifecycle: true "
        "or another placement",
        "lifecycle",
    ),
    Rule(
        "spec.nodes[]",
        "NoImage",
        "self.placement == 'Robot' || has(self.image) || has(self.build)",
        "a cluster needs the image of the replica in the cloud; add image or build",
        "image",
    ),
    Rule(
        "spec.nodes[]",
        "TwoImages",
        "!has(self.image) || !has(self.build)",
        "has both image and build; keep one of the two",
        "image",
    ),
    Rule(
        "spec.nodes[].build",
        "OneProgram",
        "has(self.executable) != has(self.launch)",
        "needs either executable or launch, and not both",
        "executable",
    ),
    Rule(
        "spec.nodes[].build",
        "NoSecret",
        "has(self.gitSecret) || self.git.url.startsWith('https://') || self.git.url.startsWith('file://')",
        "this address is read through ssh, which needs a key; add gitSecret, or write an address with https://",
        "gitSecret",
    ),
    Rule(
        "spec",
        "NoRegistry",
        "has(self.cloud.registry) || self.nodes.all(n, n.placement == 'Robot' || !has(n.build))",
        "images are built, but it is not said where they are pushed to; add registry under spec.cloud",
        "cloud.registry",
    ),
    Rule(
        "spec.nodes[]",
        "NoProgram",
        "self.placement == 'Robot' || has(self.run)",
        "a cluster must know how to start the replica in the cloud; add run",
        "run",
    ),
    Rule(
        "spec.nodes[]",
        "RemapsOutput",
        "self.placement != 'Duplicated' || !has(self.outputs) || !has(self.run) || !has(self.run.remap) || "
        "self.outputs.all(o, !(o.topic in self.run.remap) || self.run.remap[o.topic] == o.topic)",
        "run.remap moves an output; declare the output under the name that consumers know",
        "run.remap",
    ),
    Rule(
        "spec.nodes[].run",
        "TwoPrograms",
        "!has(self.command) || size(self.command) == 0 || (!has(self.package) && !has(self.executable))",
        "has both command and package or executable; keep one of the two",
    ),
    Rule(
        "spec.nodes[].run",
        "NoProgram",
        "(has(self.command) && size(self.command) > 0) || (has(self.package) && has(self.executable))",
        "needs either command, or package together with executable",
    ),
    Rule(
        "spec.nodes[].outputs[]",
        "NoRate",
        "!has(self.deadline) || has(self.rate)",
        "an output without a rate is not judged; add its rate or remove deadline",
        "deadline",
    ),
    Rule(
        "spec.nodes[].outputs[]",
        "TooShort",
        f"!has(self.deadline) || !has(self.rate) || double({_milliseconds('self.deadline')}) * self.rate > 1000.0",
        "deadline is not more than one period of the rate, so a healthy output would fail; write at least two periods",
        "deadline",
    ),
    Rule(
        "spec.nodes[].env[]",
        "ReservedVariable",
        f"!(self.name in {_cel_list(RESERVED_VARIABLES)})",
        "this variable follows from the resource and cannot be set; remove it",
        "name",
    ),
)
_SWITCHING: Final = (
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(self.lossTimeout) > {_BEAT} + {_BEAT}",
        "lossTimeout is not more than two heartbeat periods, so one lost beat would be an alarm; write for example "
        "90ms for a period of 20ms",
        "lossTimeout",
    ),
    Rule(
        "spec.switching",
        "MultipleOfPeriod",
        f"duration(self.lossTimeout) <= {_BEAT} + {_BEAT} || "
        f"{_milliseconds('self.lossTimeout')} % {_milliseconds('self.heartbeatPeriod')} != 0",
        "lossTimeout is a multiple of the heartbeat period, so the last beat and the alarm would race; write for "
        "example 90ms for a period of 20ms",
        "lossTimeout",
    ),
    Rule(
        "spec.switching.latency",
        "NeverInCloud",
        "duration(self.robotPeriod) + duration(self.tolerance) > duration(self.cloudPeriod)",
        "robotPeriod + tolerance is not more than cloudPeriod, so no link would ever be good enough; raise tolerance "
        "or lower cloudPeriod",
    ),
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(self.lease) >= duration(self.lossTimeout) + ({_LOOP}) + {_BEAT} + {_BEAT}",
        "lease is less than lossTimeout + allowed loop latency (robotPeriod + tolerance - cloudPeriod) + two "
        "heartbeats; raise it",
        "lease",
    ),
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(self.maxCommandAge) > {_LOOP} + {_BEAT}",
        "maxCommandAge is not more than the allowed loop latency (robotPeriod + tolerance - cloudPeriod) + one "
        "heartbeat, so messages of a good link would be dropped; raise it",
        "maxCommandAge",
    ),
    Rule(
        "spec.switching.holdDown",
        "OutOfRange",
        "duration(self.initial) <= duration(self.max)",
        "initial is more than max; lower it or raise max",
        "initial",
    ),
)
RULES: Final[tuple[Rule, ...]] = (*_TRANSPORT, *_CLOUD, *_NODES, *_SWITCHING)
