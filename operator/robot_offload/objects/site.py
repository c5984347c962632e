"""The facts that an agent needs beside the resource: where it runs and what it was given."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload.api.v1alpha1.names import Side
from robot_offload.objects.facts import Endpoint


@dataclass(frozen=True)
class AgentSite:
    """Where an agent runs and what it was given.

    Attributes:
        side: of the agent.
        host: robot: the cloud's name or address; cloud: the address to listen on (`0.0.0.0`: all).
        pulse_port: port of the pulse session as seen from this side; None = the resource's.
        data_port: port of the data session as seen from this side; None = the resource's.
        ca: file with the certificates for checking the other side's.
        certificate: file with this side's certificate.
        private_key: file with its key.
        endpoints: robot: the cloud's addresses by purpose; empty: `host` and the ports.
        observers: cloud: common names of certificates that may only listen, to everything; the laboratory's.
        verify_name: whether the robot checks that the cloud's certificate names `host`.
        peer_name: the common name in the other side's certificate; empty: as in certificates of our own authorities.
        uid: of the RobotOffload, for the agents to recognize each other; empty = its name.
        domain_id: ROS_DOMAIN_ID of this side; None = the resource's.
        runtime_dir: folder for sockets and pid files; empty = the agent's default.
        state_dir: folder for what must survive a reboot; empty = the agent's default.
        realtime: whether the pulse process asks for real-time priority.
        generation: of the specification from which this configuration was made; 0 = none.
        state_file: the agent's state, written by it; empty = none.
        certificate_file: the answer to the robot's request for a certificate, which the cloud's agent watches; empty =
            none.
        settings_file: the run-time settings, which the cloud's agent watches; empty = none.
        handover_file: requests the cloud's agent to hand over; empty = none.
    """

    side: Side
    host: str
    ca: str
    certificate: str
    private_key: str
    pulse_port: int | None = None
    data_port: int | None = None
    verify_name: bool = True
    uid: str = ""
    domain_id: int | None = None
    runtime_dir: str = ""
    state_dir: str = ""
    realtime: bool = False
    endpoints: tuple[Endpoint, ...] = ()
    generation: int = 0
    state_file: str = ""
    settings_file: str = ""
    certificate_file: str = ""
    peer_name: str = ""
    handover_file: str = ""
    observers: tuple[str, ...] = ()
