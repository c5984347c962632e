"""What a cloud provider does for a cluster, as a process beside it: load balancer addresses, network policies.

`python -m robot_offload_lab.cluster.attendant --marker=FILE`; it runs until it is killed.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from pathlib import Path

from robot_offload_lab.cluster import load_balancer, netns, policies
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import Layout
from robot_offload_lab.cluster.nodes_plane import NodesPlane
from robot_offload_lab.cluster.programs import Programs
from robot_offload_lab.cluster.watching import Object, ObjectWatch

WATCHED = {
    "services": "/api/v1/services",
    "slices": "/apis/discovery.k8s.io/v1/endpointslices",
    "nodes": "/api/v1/nodes",
    "policies": "/apis/networking.k8s.io/v1/networkpolicies",
    "pods": "/api/v1/pods",
    "namespaces": "/api/v1/namespaces",
}
_PAUSE = 0.05  # seconds; changes come in bursts
_LOOK = 0.5  # seconds between two checks for returned nodes and of the switch


class Attendant:
    """Checks the cluster after each change and does what is needed."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._plane = NodesPlane(layout, Programs(Path()), fast_failure=False).attached()
        self._changed = threading.Event()
        self._watches = {name: ObjectWatch(self._plane, path, self._changed.set) for name, path in WATCHED.items()}
        self._routes: dict[str, str] = {}
        self._loaded: dict[str, tuple[int, str]] = {}

    def run(self) -> None:
        """Attend until killed."""
        for watch in self._watches.values():
            watch.start()
        while True:
            if self._changed.wait(_LOOK):
                time.sleep(_PAUSE)
            self._changed.clear()
            try:
                self._balance()
                self._enforce()
            except (OSError, ClusterError) as error:  # the API server is away; or a node has just lost its power
                sys.stderr.write(f"again in a moment: {error}\n")
                time.sleep(10 * _PAUSE)
                self._changed.set()

    def _balance(self) -> None:
        seen = self._seen("services", "slices", "nodes")
        if seen is None:
            return
        services, slices, nodes = seen
        for service, address in load_balancer.missing_addresses(services, self._layout):
            metadata = service["metadata"]
            path = f"/api/v1/namespaces/{metadata['namespace']}/services/{metadata['name']}/status"
            given = {"status": {"loadBalancer": {"ingress": [{"ip": address, "ipMode": "VIP"}]}}}
            self._plane.request("PATCH", path, given, "application/merge-patch+json")
        wanted = load_balancer.routes(services, slices, nodes, self._routes, self._layout)
        lines = [f"route replace {address} via {node}" for address, node in wanted.items()]
        lines += [f"route del {address}" for address in self._routes.keys() - wanted.keys()]
        if wanted != self._routes:
            netns.ip(*lines, netns=self._layout.netns("net"))
            self._routes = wanted

    def _enforce(self) -> None:
        """Load each node's rules when they have changed, or when the node has come back without any."""
        seen = self._seen("nodes", "policies", "pods", "namespaces")
        if seen is None:
            return
        nodes, *objects = seen
        enforced = not self._layout.unenforced.exists()
        for node in (str(each["metadata"]["name"]) for each in nodes):
            place = self._layout.netns(node)
            if not netns.exists(place):  # it has no power
                continue
            rules = policies.ruleset(node, *objects) if enforced else policies.removal()
            identity = (netns.NAMED / place).stat().st_ino
            if self._loaded.get(node) != (identity, rules):
                netns.nft(rules, place)
                self._loaded[node] = (identity, rules)

    def _seen(self, *names: str) -> list[list[Object]] | None:
        """Return all objects of these kinds; None until all have been listed once."""
        found = [self._watches[name].objects() for name in names]
        return None if any(each is None for each in found) else [each for each in found if each is not None]


def main() -> None:
    """Attend one cluster."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--marker", required=True, type=Path, help="the cluster's marker file")
    chosen = parser.parse_args()
    Attendant(Layout(json.loads(chosen.marker.read_text())["number"])).run()


if __name__ == "__main__":
    main()
