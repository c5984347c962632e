"""The tunnel between the two DDS Routers: the agent package's `robot-offload-tunnel`, one end on each side.

The router itself can neither authenticate the robot nor cope with strangers: it handles one TLS handshake after the
other, without a time limit, so a probe or a scan of its port delays all its traffic. So only the tunnel is reachable
from outside. Its file is read by `robot_offload_agent.tunnel.configuration`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from robot_offload.kube.port import Manifest
from robot_offload.objects import pod
from robot_offload.objects.facts import Endpoint, Facts, address
from robot_offload.transport import dds_router_xml as wan
from robot_offload.transport.port import ContainerPort

PORT: Final = ContainerPort("router", "TCP", 11666)
FILE: Final = "tunnel.yaml"
PROGRAM: Final = "robot-offload-tunnel"


@dataclass(frozen=True, slots=True)
class Proof:
    """The credentials of an end of the tunnel, and whom it trusts.

    Attributes:
        ca: PEM file of the authority of the other side.
        certificate: PEM file of this side's certificate.
        private_key: PEM file of its key.
        own: folder for a newer pair, which may come later; empty: there is never one.
    """

    ca: str
    certificate: str
    private_key: str
    own: str = ""


def cloud_end(listen: str, router: str, proof: Proof, robot: str) -> dict[str, Any]:
    """Return the file of the cloud's end, which waits for the robot and then goes to the router beside it.

    Args:
        listen: HOST:PORT for the robot.
        router: HOST:PORT of the router.
        proof: the cloud's files.
        robot: the robot's name in its certificate; an issuer may sign for many robots.
    """
    proved = {"ca": proof.ca, "certificate": proof.certificate, "private_key": proof.private_key}
    return {"side": "cloud", "listen": listen, "connect": [router], **proved, "peer_name": robot}


def robot_end(
    listen: str, connect: Sequence[str], proof: Proof, *, verify_name: bool, realtime: bool = True
) -> dict[str, Any]:
    """Return the file of the robot's end, which waits for the router beside it and then dials the cloud.

    Args:
        listen: HOST:PORT for the router.
        connect: HOST:PORT of the cloud's end, tried in this order.
        proof: the robot's files.
        verify_name: whether the cloud's certificate must contain the dialled name.
        realtime: whether to request real-time priority.
    """
    return {
        "side": "robot",
        "listen": listen,
        "connect": list(connect),
        **asdict(proof),
        "verify_name": verify_name,
        "realtime": realtime,
    }


def in_the_cloud(robot: str) -> dict[str, Any]:
    """Return the file of the cloud's end in its pod."""
    folder = pod.CERTIFICATES_DIR
    return cloud_end(
        address("0.0.0.0", PORT.number),  # noqa: S104 - the pod's only interface; the network policy restricts access
        address(wan.HOST, wan.LISTENING),
        Proof(f"{folder}/ca.crt", f"{folder}/tls.crt", f"{folder}/tls.key"),
        robot,
    )


def on_the_robot(
    endpoints: Sequence[Endpoint], certificates: str, state_dir: str, *, verify_name: bool
) -> dict[str, Any]:
    """Return the file of the robot's end in the bundle.

    Args:
        endpoints: addresses of the cloud's end.
        certificates: the folder of the bundle's certificates.
        state_dir: the agent's folder for what survives a reboot: the pairs that it renews.
        verify_name: whether the cloud's certificate must contain the dialled name.
    """
    return robot_end(
        address(wan.HOST, wan.MEETING),
        [one.address for one in endpoints],
        Proof(
            f"{certificates}/ca.pem",
            f"{certificates}/robot.pem",
            f"{certificates}/robot.key",
            f"{state_dir}/certificates/current",
        ),
        verify_name=verify_name,
    )


def container(facts: Facts, folder: str, mounts: Sequence[Manifest]) -> Manifest:
    """Return the container of the cloud's end; `folder` contains its file."""
    return pod.container(
        "tunnel",
        facts.images.agent,
        [PROGRAM, "--params", f"{folder}/{FILE}"],
        environment={"HOME": pod.TMP},
        mounts=mounts,
        # No CPU limit: throttling takes longer than the loss timeout.
        resources={"requests": {"cpu": "50m", "memory": "32Mi"}, "limits": {"memory": "256Mi"}},
        extra={
            "ports": [{"name": PORT.name, "containerPort": PORT.number, "protocol": PORT.protocol}],
            "readinessProbe": pod.listens(PORT.number),
        },
    )
