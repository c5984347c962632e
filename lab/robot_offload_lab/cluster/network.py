"""The cluster's network: a bridge with a router, a place for wires, and this machine at one end of it."""

from __future__ import annotations

import ipaddress
import json

from robot_offload_lab.cluster import netns
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import Layout

LAN, OUTSIDE = "lan", "outside"


def build(layout: Layout) -> None:
    """Make everything except nodes and robots.

    Three namespaces: `net` holds the bridge of the cluster, the bridge on the robots' side and routes between the two;
    `wires` only holds the ends of wires and has no address; `plane` is for the control plane.
    """
    refuse_overlap(layout)
    switchboard(layout)
    netns.make(layout.netns("plane"))
    netns.ip(
        f"addr add {layout.host}/24 dev {layout.name}",
        f"route add {layout.everything} via {layout.router} dev {layout.name}",
    )
    plug(layout, layout.netns("plane"), layout.api, "plane")


def switchboard(layout: Layout) -> None:
    """Make `net` and `wires`, and a cable from the bridge of the cluster to an interface of this machine."""
    net = layout.netns("net")
    netns.make(net, forwards=True)
    netns.make(layout.netns("wires"))
    netns.ip(
        # With addresses of their own: otherwise they take that of a port, and another one when that port goes.
        f"link add {LAN} address 02:00:00:00:{layout.number:02x}:01 type bridge",
        f"link add {OUTSIDE} address 02:00:00:00:{layout.number:02x}:02 type bridge",
        f"addr add {layout.router}/24 dev {LAN}",
        f"addr add {layout.outside}/24 dev {OUTSIDE}",
        f"link set {LAN} up",
        f"link set {OUTSIDE} up",
        # These addresses are not in use yet: packets for them are refused, not sent in circles.
        f"route add unreachable {layout.everything}",
        *layout.pod_routes,
        netns=net,
    )
    # Frames between nodes only pass through here; the nodes filter them.
    netns.run("sysctl", "-q", "-w", "net.bridge.bridge-nf-call-iptables=0", netns=net)
    netns.ip(f"link add {layout.name} type veth peer name host netns {net}", f"link set {layout.name} up")
    netns.ip(f"link set host master {LAN} up", netns=net)


def refuse_overlap(layout: Layout) -> None:
    """Refuse addresses that this machine uses already.

    Raises:
        ClusterError: It uses some of them.
    """
    ours = ipaddress.ip_network(layout.everything)
    for route in json.loads(netns.run("ip", "-json", "-4", "route", "show")):
        if route["dst"] != "default" and ipaddress.ip_network(route["dst"]).overlaps(ours):
            raise ClusterError(
                f"This machine already knows a way to {route['dst']} (dev {route['dev']}), and the addresses of "
                f"cluster {layout.number} are {layout.everything}. Next: take another number"
            )


def plug(layout: Layout, place: str, address: str, port: str) -> None:
    """Connect a namespace to the bridge of the cluster.

    Args:
        layout: Layout of the cluster.
        place: The namespace; its interface is eth0.
        address: The address of that interface.
        port: Name of the interface on the bridge's side.
    """
    net = layout.netns("net")
    netns.ip(f"link add {port} type veth peer name eth0 netns {place}", f"link set {port} master {LAN} up", netns=net)
    netns.ip(
        f"addr add {address}/24 dev eth0", "link set eth0 up", f"route add default via {layout.router}", netns=place
    )


def unplug(layout: Layout, port: str) -> None:
    """Unplug the cable of a port; the link stays up."""
    netns.ip(f"link set {port} nomaster", netns=layout.netns("net"))


def replug(layout: Layout, port: str) -> None:
    """Put the cable back."""
    netns.ip(f"link set {port} master {LAN}", netns=layout.netns("net"))


def remove(layout: Layout) -> None:
    """Remove every namespace of the cluster and its interface on this machine."""
    for each in netns.named(f"{layout.name}-"):
        netns.remove(each)
    if (netns.INTERFACES / layout.name).exists():
        netns.ip(f"link del {layout.name}")
