"""Names and addresses of one cluster: its number determines them, so that several clusters can run side by side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robot_offload_lab.cluster import programs
from robot_offload_lab.cluster.errors import ClusterError

STATE = Path("/var/tmp/robot-offload-cluster")  # not per user: names of network namespaces belong to the machine
NUMBERS = range(10)
MOST_NODES = 8
_FIRST_NETWORK = 120


@dataclass(frozen=True, slots=True)
class Layout:
    """Where everything of one cluster is.

    Addresses, with X = 120 + number: the cluster's own network 10.X.0.0/24 (this machine .1, router .2, control plane
    .10, nodes from .11, neighbours from .100), load balancer addresses 10.X.1.0/24, the far side of the robots'
    gateways 10.X.2.0/24, pods of node i 10.X.(16+i).0/24, Services 10.X.128.0/20.
    """

    number: int

    def __post_init__(self) -> None:
        if self.number not in NUMBERS:
            raise ClusterError(f"The number of a cluster is 0 to {NUMBERS[-1]}, not {self.number}")

    @property
    def name(self) -> str:
        """First word of the names of network namespaces, interfaces and cgroups."""
        return f"rof{self.number}"

    @property
    def home(self) -> Path:
        """The folder that is removed with the cluster."""
        return STATE / str(self.number)

    @property
    def marker(self) -> Path:
        """File that marks everything as ours, since which boot of the machine."""
        return self.home / "marker.json"

    @property
    def unenforced(self) -> Path:
        """While this file exists, network policies are not enforced."""
        return self.home / "policies-off"

    @property
    def registries(self) -> Path:
        """Its nodes' settings of container registries: a folder for each, named as in the names of images."""
        return self.home / "registries"

    @property
    def plane(self) -> Path:
        """Directory of the control plane."""
        return self.home / "plane"

    @property
    def kept(self) -> Path:
        """What stays for the next cluster of this number: imported images."""
        return programs.cache().parent / "nodes" / self.name

    @property
    def host(self) -> str:
        """Address of this machine in the cluster's network."""
        return self._address(0, 1)

    @property
    def router(self) -> str:
        """Default gateway of the nodes."""
        return self._address(0, 2)

    @property
    def api(self) -> str:
        """Address of the control plane."""
        return self._address(0, 10)

    @property
    def everything(self) -> str:
        """All addresses of the cluster."""
        return f"{self._address(0, 0)}/16"

    @property
    def balancers(self) -> str:
        """Addresses of Services of type LoadBalancer."""
        return f"{self._address(1, 0)}/24"

    @property
    def outside(self) -> str:
        """The router's address on the side of the robots."""
        return self._address(2, 1)

    @property
    def pods(self) -> str:
        """Addresses of all pods."""
        return f"{self._address(16, 0)}/20"

    @property
    def services(self) -> str:
        """Cluster addresses of Services."""
        return f"{self._address(128, 0)}/20"

    @property
    def first_service(self) -> str:
        """Address at which pods find the API server."""
        return self._address(128, 1)

    @property
    def names_service(self) -> str:
        """Address of the pods' name server."""
        return self._address(128, 10)

    def netns(self, word: str) -> str:
        """Return the name of a network namespace."""
        return f"{self.name}-{word}"

    def node(self, index: int) -> str:
        """Return the address of a node; the first has index 1."""
        return self._address(0, 10 + index)

    def node_pods(self, index: int) -> str:
        """Return the addresses of the pods on one node."""
        return f"{self._address(16 + index, 0)}/24"

    @property
    def pod_routes(self) -> tuple[str, ...]:
        """The routes to pods that the cluster's network has from the start."""
        return tuple(f"route add {self.node_pods(each)} via {self.node(each)}" for each in range(1, MOST_NODES + 1))

    def neighbour(self, index: int) -> str:
        """Return the address of a machine in the cluster's network that is not a node."""
        return self._address(0, 100 + index)

    def gateway(self, index: int, turn: int = 0) -> str:
        """Return the address of a robot's NAT gateway on the cluster's side; each turn has another one."""
        return self._address(2, 10 + index + 100 * (turn % 2))

    def balancer(self, index: int) -> str:
        """Return one of the load balancer addresses."""
        return self._address(1, index)

    def _address(self, third: int, last: int) -> str:
        return f"10.{_FIRST_NETWORK + self.number}.{third}.{last}"
