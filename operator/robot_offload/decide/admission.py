"""Whether the chart's admission policy judged an object: the operator acts with its own rights.

At the moment of writing, the policy checks whether the writer has the rights to what is asked for. What was written
without a policy (before it was enabled, or after it was deleted) was not judged. Such an object acts again once a user
with those rights vouches for it: the policy judges the writer of the annotation `ADMITTED`.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from typing import Final

from robot_offload.api.v1alpha1 import Node, RobotOffload
from robot_offload.findings import Finding
from robot_offload.kube.port import Manifest

ADMITTED: Final = "robotoffload.dev/admitted"
"""Annotation on a RobotOffload: the uid of the policy under which all of it was judged."""
REACH: Final = datetime.timedelta(seconds=3)
"""How long the API server may take until a new policy is in force."""


@dataclass(frozen=True, slots=True)
class InForce:
    """The policy as the API server has it.

    Attributes:
        uid: of the policy; a changed uid means another policy.
        since: since when both policy and binding exist.
    """

    uid: str
    since: datetime.datetime


def in_force(policy: Manifest | None, binding: Manifest | None) -> InForce | None:
    """Return the policy; None: it is not in force, because it or its binding is missing."""
    if policy is None or binding is None:
        return None
    made = (datetime.datetime.fromisoformat(one["metadata"]["creationTimestamp"]) for one in (policy, binding))
    return InForce(policy["metadata"]["uid"], max(made))


def asks(offload: RobotOffload) -> bool:
    """Return whether an object asks for what the policy guards: Secrets, ConfigMaps, issuers, addresses, places."""
    cloud, transport = offload.spec.cloud, offload.spec.transport
    registry, expose = cloud.registry, transport.expose
    guarded = (
        cloud.image_pull_secrets,
        registry is not None and (registry.push_secret or registry.pull_secret),
        cloud.tolerations,
        cloud.pod_spec,
        cloud.node_selector,
        transport.certificates.issuer_ref,
        expose.address,
        expose.load_balancer_class,
        expose.node_ports,
        expose.annotations,
    )
    return any(guarded) or any(map(_node_asks, offload.spec.nodes))


def _node_asks(node: Node) -> bool:
    from_file = node.run is not None and node.run.parameters_from is not None
    from_elsewhere = any(one.value_from is not None for one in node.env)
    return bool(
        from_file or from_elsewhere or node.build or node.node_selector or node.runtime_class_name or node.pod_spec
    )


def finding(raw: Manifest, offload: RobotOffload, name: str, policy: InForce | None) -> Finding | None:
    """Return why an object may not act; None: it may.

    Args:
        raw: as the API server has it.
        offload: the same, parsed.
        name: of the policy.
        policy: as the API server has it; None: it is missing.
    """
    if not asks(offload):
        return None
    if policy is None:
        return Finding(
            "metadata",
            "NotAdmitted",
            f"the admission policy {name} or its binding is missing, so it was not checked whether the writer may ask "
            "for the Secrets, ConfigMaps, issuers, addresses or nodes that it names; helm upgrade makes the policy",
        )
    metadata = raw["metadata"]
    made = datetime.datetime.fromisoformat(metadata["creationTimestamp"])
    if made > policy.since + REACH or (metadata.get("annotations") or {}).get(ADMITTED) == policy.uid:
        return None
    own = f"{metadata['name']} -n {metadata['namespace']}"
    return Finding(
        "metadata",
        "NotAdmitted",
        "it is older than the admission policy, and names Secrets, ConfigMaps, issuers, addresses or nodes; who has "
        f"the rights to them vouches for it: kubectl annotate roff {own} --overwrite {ADMITTED}={policy.uid}",
    )
