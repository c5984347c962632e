"""Rules about services, actions, state, and the conditions and transforms of outputs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from robot_offload.api.v1alpha1.names import identifier
from robot_offload.api.v1alpha1.nodes import Node, flat_parameters
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.findings import repeated
from robot_offload.api.v1alpha1.rules.nodes import milliseconds
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.findings import Finding

MOST_NAMES: Final = 256
"""Services and actions of one RobotOffload together, served and used: all stand in the agents' ConfigMap."""
_HAS_SERVED: Final = (
    "((has(self.services) && size(self.services) > 0) || (has(self.actions) && size(self.actions) > 0))"
)
_HAS_USES: Final = (
    "(has(self.uses) && ((has(self.uses.services) && size(self.uses.services) > 0) || "
    "(has(self.uses.actions) && size(self.uses.actions) > 0)))"
)


def _hot(node: Node) -> bool:
    return not node.lifecycle or "Hot" in (node.standby.robot, node.standby.cloud)


def _kinds(state: Any) -> int:
    return sum((state.topic is not None or state.restore is not None, state.parameters is not None, state.snapshot))


RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "spec.nodes[].actions[]",
        "Contradiction",
        "!has(self.holdFor) || (has(self.onSwitch) && self.onSwitch == 'Hold')",
        lambda action: action.hold_for_ms is not None and action.on_switch != "Hold",
        "holdFor says how long a change waits for a goal, which only onSwitch Hold makes it do; remove holdFor or "
        "write onSwitch: Hold",
        "holdFor",
    ),
    Rule(
        "spec.nodes[].actions[]",
        "TwiceNotAllowed",
        "!self.mirror || (has(self.onSwitch) && self.onSwitch in ['Resend', 'Continue'])",
        lambda action: action.mirror and action.on_switch not in ("Resend", "Continue"),
        "mirror runs each goal on both sides, but only goals with onSwitch Resend or Continue "
        "may be executed twice; remove mirror",
        "mirror",
    ),
    Rule(
        "spec.nodes[]",
        "NoMirror",
        "!has(self.actions) || self.actions.all(a, !a.mirror) || (self.placement == 'Duplicated' && "
        "(!self.lifecycle || (has(self.standby) && (self.standby.robot == 'Hot' || self.standby.cloud == 'Hot'))) && "
        f"!{_HAS_USES})",
        lambda node: any(it.mirror for it in node.actions) and not (node.duplicated and _hot(node) and not node.called),
        "mirror needs a replica that is Hot and calls no server: its calls would reach the robot twice; write standby "
        "Hot and no uses, or remove mirror",
        "actions",
    ),
    Rule(
        "spec.nodes[]",
        "ServedByItself",
        f"self.placement != 'Robot' || !({_HAS_SERVED} || {_HAS_USES})",
        lambda node: node.placement == "Robot" and bool(node.offered or node.called),
        "a node with placement Robot serves and calls by itself, there is no other side to choose from; remove "
        "services, actions and uses",
    ),
    Rule(
        "spec.nodes[]",
        "OneReplica",
        "self.placement != 'Cloud' || !has(self.services) || "
        "self.services.all(s, s.mode == 'Holder' || s.mode == 'Idempotent')",
        lambda node: node.placement == "Cloud" and any(it.mode in ("Both", "Race") for it in node.services),
        "a node with placement Cloud has one replica, so a call cannot be executed a second time; write mode Holder "
        "or Idempotent",
        "services",
    ),
    Rule(
        "spec.nodes[]",
        "NoReplica",
        "self.placement != 'Cloud' || !has(self.actions) || self.actions.all(a, !has(a.onSwitch))",
        lambda node: node.placement == "Cloud" and any(it.on_switch is not None for it in node.actions),
        "a goal of a node with placement Cloud runs whoever acts, and ends aborted when the cloud is away; remove "
        "onSwitch",
        "actions",
    ),
    Rule(
        "spec.nodes[]",
        "NoReplica",
        "self.placement == 'Duplicated' || !has(self.state) || size(self.state) == 0",
        lambda node: not node.duplicated and bool(node.state),
        "state goes to the replica of a Duplicated node, and this node has none; remove state",
        "state",
    ),
    Rule(
        "spec.nodes[].state[]",
        "OneKind",
        "(has(self.topic) || has(self.restore) ? 1 : 0) + (has(self.parameters) ? 1 : 0) + (self.snapshot ? 1 : 0) == "
        "1",
        lambda state: _kinds(state) != 1,
        "is one of three: topic together with restore, parameters, or snapshot: true; write each as an entry of its "
        "own",
    ),
    Rule(
        "spec.nodes[].state[]",
        "Required",
        "has(self.topic) == has(self.restore) && (!has(self.topic) || !has(self.restore) || "
        "self.topic != self.restore)",
        lambda state: (state.topic is None) != (state.restore is None)
        or (state.topic is not None and state.topic == state.restore),
        "needs topic (what the node publishes) together with another topic of the same type, restore (where its "
        "replica takes it from), e.g. /amcl_pose and /initialpose",
    ),
    Rule(
        "spec.nodes[].state[]",
        "Contradiction",
        "self.snapshot || (!has(self.maxAge) && !has(self.maxSize))",
        lambda state: not state.snapshot and (state.max_age_ms is not None or state.max_size is not None),
        "maxAge and maxSize are about snapshots; remove them or write snapshot: true",
    ),
    Rule(
        "spec.nodes[].outputs[].while",
        "OneKind",
        "(has(self.actions) && size(self.actions) > 0) != has(self.topic)",
        lambda it: bool(it.actions) == (it.topic is not None),
        "needs either actions or a topic",
    ),
    Rule(
        "spec.nodes[].outputs[].while",
        "Required",
        "has(self.topic) == has(self.within)",
        lambda it: (it.topic is None) != (it.within_ms is None),
        "topic goes with within, the time that one message of it counts, e.g. 200ms",
    ),
    Rule(
        "spec.nodes[].outputs[]",
        "NoRate",
        "!has(self.__while__) || has(self.rate)",
        lambda output: output.while_ is not None and output.rate_hz is None,
        "an output without a rate is never judged, so while says nothing; add its rate or remove while",
        "while",
    ),
    Rule(
        "spec.nodes[].outputs[]",
        "NoTransforms",
        "!has(self.frames) || size(self.frames) == 0 || self.topic.endsWith('/tf')",
        lambda output: bool(output.frames) and not output.topic.endswith("/tf"),
        "frames are transforms, which travel on /tf; remove frames or declare /tf",
        "frames",
    ),
    Rule(
        "spec.nodes[].outputs[].frames[]",
        "Contradiction",
        "self.parent != self.child",
        lambda frame: frame.parent == frame.child,
        "parent and child are the same frame; write the two that the transform joins",
        "child",
    ),
    Rule(
        "spec.nodes[]",
        "NotOfCloud",
        "self.placement == 'Cloud' || !has(self.outputs) || self.outputs.all(o, !has(o.maxAge))",
        lambda node: node.placement != "Cloud" and any(it.max_age_ms is not None for it in node.outputs),
        "maxAge is for outputs of nodes with placement Cloud; for others switching.maxCommandAge holds, remove maxAge",
        "outputs",
    ),
    Rule(
        "spec.nodes[]",
        "AlwaysHot",
        "self.placement != 'Duplicated' || self.lifecycle || !has(self.standby) || "
        "(self.standby.robot == 'Hot' && self.standby.cloud == 'Hot')",
        lambda node: node.duplicated and not node.lifecycle and "standby" in node.model_fields_set
        and (node.standby.robot, node.standby.cloud) != ("Hot", "Hot"),
        "a node without a lifecycle cannot be put to sleep, it is Hot on both sides; remove standby or write both Hot",
        "standby",
    ),
    Rule(
        "spec.nodes[]",
        "NothingDeclared",
        f"self.placement != 'Duplicated' || self.lifecycle || (has(self.outputs) && size(self.outputs) > 0) || "
        f"{_HAS_SERVED}",
        lambda node: node.duplicated and not node.lifecycle and not node.outputs and not node.offered,
        "a Duplicated node without a lifecycle is alive when its names are seen, so it needs some; list its outputs, "
        "services or actions",
        "outputs",
    ),
    Rule(
        "spec.topics.toCloud[]",
        "OutOfRange",
        "!has(self.minRate) || !has(self.maxRate) || self.minRate <= self.maxRate",
        lambda it: bool(it.min_rate_hz and it.max_rate_hz) and it.min_rate_hz > it.max_rate_hz,
        "minRate is more than maxRate; lower it or raise maxRate",
        "minRate",
    ),
    Rule(
        "spec.topics.toCloud[]",
        "OutOfRange",
        "!has(self.minRate) || !has(self.maxAge) || "
        f"double(self.minRate) * double({milliseconds('self.maxAge')}) >= 1000.0",
        lambda it: bool(it.min_rate_hz and it.max_age_ms) and it.min_rate_hz * it.max_age_ms < 1000,
        "at minRate messages are further apart than maxAge, so the cloud would not be fit to act; raise one of them",
        "minRate",
    ),
    Rule(
        "spec.topics.toCloud[]",
        "Contradiction",
        "!self.latched || (!self.latest && !has(self.minRate))",
        lambda it: it.latched and (it.latest or it.min_rate_hz is not None),
        "of a latched topic every value counts; leave latest and minRate out",
        "latched",
    ),
    Rule(
        "spec.switching",
        "TooShort",
        "!has(self.prepareDeadline) || duration(self.prepareDeadline) >= duration(self.activationDeadline)",
        lambda it: it.prepare_deadline_ms is not None and it.prepare_deadline_ms < it.activation_deadline_ms,
        "prepareDeadline is less than activationDeadline, in which nodes become active; raise it",
        "prepareDeadline",
    ),
)  # fmt: skip


def names_have_one_meaning(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A remapping moves every topic, service and action of one name at once, so each name has one meaning."""
    served = list(_served(spec))
    yield from repeated(served, "ServedTwice", "is offered by two nodes, so nobody could tell whose answer counts; "
                        "rename one")  # fmt: skip
    topics = {it.topic: "an output" for node in spec.nodes for it in node.outputs}
    topics |= {it.name: "in topics.toCloud" for it in spec.topics.to_cloud}
    identifiers: dict[str, str] = {}
    for path, name in (*served, *((path, name) for path, name, _ in _used(spec))):
        if name in topics:
            yield Finding(
                path,
                "TwoMeanings",
                f"{name!r} is {topics[name]} as well, and ROS 2 renames both at once; rename one of the two",
            )
        other = identifiers.setdefault(identifier(name), name)
        if other != name:
            yield Finding(path, "AmbiguousName", f"{name!r} and {other!r} differ only in underscores; rename one")


def _served(spec: RobotOffloadSpec) -> Iterator[tuple[str, str]]:
    for i, node in enumerate(spec.nodes):
        yield from ((f"spec.nodes[{i}].services[{j}].name", it.name) for j, it in enumerate(node.services))
        yield from ((f"spec.nodes[{i}].actions[{j}].name", it.name) for j, it in enumerate(node.actions))


def _used(spec: RobotOffloadSpec) -> Iterator[tuple[str, str, Node]]:
    for i, node in enumerate(spec.nodes):
        uses, path = node.uses, f"spec.nodes[{i}].uses"
        yield from ((f"{path}.services[{j}].name", it.name, node) for j, it in enumerate(uses.services))
        yield from ((f"{path}.actions[{j}].name", it.name, node) for j, it in enumerate(uses.actions))


def clients_find_their_servers(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A node of the group calls its own side's server; nobody serves a client in the cloud outside the group."""
    servers = {it.name: (node, it.type) for node in spec.nodes for it in node.offered}
    for path, name, node in _used(spec):
        if name not in servers:
            continue
        server, offered = servers[name]
        if server.placement != node.placement:
            who = "in the cloud, while the acting side changes" if server.duplicated else "from the robot's replica"
            yield Finding(
                path,
                "NotServed",
                f"node {node.name!r} ({node.placement}) cannot call {name!r} of {server.name!r} ({server.placement}) "
                f"{who}; give both nodes one placement",
            )
        if all(it.type != offered for it in node.called if it.name == name):
            yield Finding(path, "OtherType", f"{name!r} is a {offered} of {server.name!r}; write that type")


def names_outside_have_one_placement(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Call of Duplicated nodes pass while their side acts, those of Cloud nodes always: one name cannot do both."""
    served = {it.name for node in spec.nodes for it in node.offered}
    placements: dict[str, Node] = {}
    for path, name, node in _used(spec):
        other = placements.setdefault(name, node)
        if name not in served and other.placement != node.placement:
            yield Finding(
                path,
                "TwoPlacements",
                f"{name!r} is used by {other.name!r} ({other.placement}) too, and the agent in the cloud could not "
                "know whose call it is; give both nodes one placement",
            )


def conditions_name_actions_of_the_group(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Whether a goal is executed is known of declared actions only."""
    known = {it.name for node in spec.nodes if node.duplicated for it in node.actions}
    for i, node in enumerate(spec.nodes):
        for j, output in enumerate(node.outputs):
            for name in output.while_.actions if output.while_ is not None else ():
                if name not in known:
                    yield Finding(
                        f"spec.nodes[{i}].outputs[{j}].while.actions",
                        "UnknownAction",
                        f"{name!r} is not an action of a Duplicated node; list it under the actions of the node that "
                        "offers it",
                    )


def conditions_name_topics_of_both_sides(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Whether a topic arrives is known on both sides of those that the agents carry to the cloud."""
    carried = {topic.name for topic in spec.topics.to_cloud} if spec.transport.type == "Zenoh" else set()
    for i, node in enumerate(spec.nodes):
        for j, output in enumerate(node.outputs):
            path = f"spec.nodes[{i}].outputs[{j}].while"
            topic = output.while_.topic if output.while_ is not None else None
            if topic is None or output.while_ is None:
                continue
            if output.while_.within_ms is not None and output.while_.within_ms >= output.judged_after_ms > 0:
                yield Finding(
                    f"{path}.within",
                    "EndLooksLikeFault",
                    f"must be shorter than the output's deadline, {output.judged_after_ms:g}ms: else the output counts "
                    f"as silent each time that {topic!r} ends",
                )
            if topic in carried:
                continue
            advice = f"add {topic!r} to topics.toCloud" if spec.transport.type == "Zenoh" else "use transport Zenoh"
            yield Finding(
                f"{path}.topic",
                "UnknownTopic",
                f"the agents do not see when {topic!r} arrives on either side; {advice}, or remove while",
            )


def poses_are_kept(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """AMCL with `set_initial_pose` jumps to the configured pose at each activation: at each change of the side."""
    for i, node in enumerate(spec.nodes):
        if not node.duplicated or node.run is None:
            continue
        for field, mapping in (("parameters", node.run.parameters), ("cloudParameters", node.run.cloud_parameters)):
            if dict(flat_parameters(mapping)).get("set_initial_pose") is True:
                yield Finding(
                    f"spec.nodes[{i}].run.{field}.set_initial_pose",
                    "PoseJumps",
                    "AMCL would go back to its configured pose at every change of the acting side; write false, and "
                    "give the first pose once, on /initialpose",
                )


def copied_parameters_have_a_replica(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Child nodes are not of the resource; a node that is has to run on both sides."""
    placements = {node.name: node.placement for node in spec.nodes}
    for i, node in enumerate(spec.nodes):
        for j, state in enumerate(node.state):
            for k, name in enumerate(state.parameters.nodes if state.parameters is not None else ()):
                if placements.get(name, "Duplicated") != "Duplicated":
                    yield Finding(
                        f"spec.nodes[{i}].state[{j}].parameters.nodes[{k}]",
                        "NoReplica",
                        f"{name!r} has placement {placements[name]} and runs on one side only; remove it here",
                    )


def not_too_many_names(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The agents' configuration has to fit into one ConfigMap."""
    count = len(list(_served(spec))) + len(list(_used(spec)))
    if count > MOST_NAMES:
        yield Finding(
            "spec.nodes",
            "TooMany",
            f"there are {count} services and actions, served and used; at most {MOST_NAMES} fit",
        )
