"""Whether the cloud's addresses for the robot are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide.verdicts import Verdict, no, yes
from robot_offload.objects.facts import Endpoint
from robot_offload.transport import exposure

_PENDING: Final = {
    "LoadBalancer": "the cluster's load balancer has given none to a Service; a cluster without a load balancer gives "
    "none ever: spec.transport.expose.type NodePort does without",
    "NodePort": "no node of the cluster is ready, or the operator has no right to read nodes: name an address that "
    "leads to them in spec.transport.expose.host",
    "ClusterIP": "the Services have no addresses in the cluster yet",
}


def addresses_ready(offload: RobotOffload, endpoints: Sequence[Endpoint]) -> Verdict:
    """Return whether all addresses that the robot needs are known, for the condition AddressesReady."""
    missing = transport.missing_purposes(offload, endpoints)
    if missing:
        why = _PENDING[offload.spec.transport.expose.type]
        return no("AddressPending", f"No address is known for {', '.join(missing)}: {why}")
    unheard = [point.address for point in endpoints if exposure.is_ipv6(point.host)]
    if unheard:
        return no(
            "AddressFamily",
            f"Nothing listens on IPv6 in the cloud, so {', '.join(unheard)} leads nowhere: give the Services IPv4 "
            "addresses (in a dual-stack cluster by its load balancer), or name an IPv4 address in "
            "spec.transport.expose.host",
        )
    if not transport.of(offload.spec).purposes(offload):
        return yes("NotNeeded", "With this transport the robot needs no address of the cloud")
    return yes("Known", f"The robot finds the cloud at {', '.join(point.address for point in endpoints)}")
