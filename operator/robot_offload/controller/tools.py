"""What every pass works with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from robot_offload.controller.clock import Clock
from robot_offload.controller.preread import Preread
from robot_offload.controller.store import Store
from robot_offload.decide import rollouts
from robot_offload.kube.port import KubeApi
from robot_offload.objects.facts import HOME, Images, Network


@dataclass(frozen=True, slots=True)
class Policy:
    """What whoever runs the operator has decided for the whole cluster.

    Attributes:
        max_rolling: of how many robots pods are replaced at once when the operator itself wants other pods.
        load_balancer_node_ports: whether Services of type LoadBalancer get node ports, too.
        network: what is decided about network policies.
        home: the operator's own namespace; the keys of the robots' authorities are there.
        adopt: whether a RobotOffload goes on with the authorities of an earlier one of its name.
        pull_secrets: names of Secrets with which images of all robots are fetched.
        pod_spec: what is said about all pods of robots, laid under what a RobotOffload says.
        admission: the name of the admission policy and of its binding; empty: what was written is not checked again.
    """

    max_rolling: int = rollouts.AT_ONCE
    load_balancer_node_ports: bool = True
    network: Network = field(default_factory=Network)
    home: str = HOME
    adopt: bool = True
    pull_secrets: tuple[str, ...] = ()
    pod_spec: Mapping[str, Any] = field(default_factory=dict)
    admission: str = ""


@dataclass(frozen=True, slots=True)
class Tools:
    """What every pass works with.

    Attributes:
        api: reads and writes.
        store: what the watches have brought.
        images: of our own programs.
        clock: both clocks.
        policy: what holds for the whole cluster.
        budget: how many robots may have their pods replaced at once.
        preread: the certificates as they were when the operator started.
    """

    api: KubeApi
    store: Store
    images: Images
    clock: Clock
    policy: Policy
    budget: rollouts.Budget[tuple[str, str]]
    preread: Preread = field(default_factory=Preread)
