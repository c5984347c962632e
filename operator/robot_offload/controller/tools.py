"""Shared by all passes."""

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
    """Decisions of the operator's administrator for the whole cluster.

    Attributes:
        max_rolling: number of robots whose pods are replaced at once when the operator itself wants other pods.
        load_balancer_node_ports: whether Services of type LoadBalancer get node ports, too.
        network: decisions about network policies.
        home: the operator's own namespace, which holds the keys of the robots' authorities.
        adopt: whether a RobotOffload adopts the authorities of an earlier one of its name.
        pull_secrets: names of Secrets for pulling the images of all robots.
        pod_spec: defaults for the pods of all robots; a RobotOffload overrides them.
        admission: name of the admission policy and of its binding; empty: objects are not checked again.
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
    """Shared by all passes.

    Attributes:
        api: reads and writes.
        store: the objects from the watches.
        images: of our own programs.
        clock: both clocks.
        policy: for the whole cluster.
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
