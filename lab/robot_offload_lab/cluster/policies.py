"""NetworkPolicies as nftables rules of each node, because the nodes' network plugin does not enforce them.

Understood: podSelector, namespaceSelector, ipBlock with except, ports with endPort, named ports of incoming traffic.
A named port of outgoing traffic allows nothing. Traffic of a node with its own pods always passes, as Kubernetes
specifies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from robot_offload_lab.cluster import netns

Object = Mapping[str, Any]
TABLE = "robot_offload_policy"
_ADDRESS = {"in": "saddr", "out": "daddr"}  # where the other end's address stands


def ruleset(node: str, policies: Iterable[Object], pods: Iterable[Object], namespaces: Iterable[Object]) -> str:
    """Return all rules of one node, to be loaded at once.

    Args:
        node: Its name.
        policies: NetworkPolicies of the cluster.
        pods: Of the cluster.
        namespaces: Of the cluster.
    """
    labels = {each["metadata"]["name"]: each["metadata"].get("labels", {}) for each in namespaces}
    there = sorted(filter(_has_address, pods), key=lambda pod: str(pod["status"]["podIP"]))
    policies = sorted(policies, key=lambda each: (each["metadata"]["namespace"], each["metadata"]["name"]))
    chains: dict[str, list[str]] = {}
    jumps: dict[str, list[str]] = {"in": [], "out": []}
    for pod in there:
        if pod["spec"].get("nodeName") != node:
            continue
        for way in ("in", "out"):
            rules = _rules(way, pod, policies, there, labels)
            if rules is not None:
                address = str(pod["status"]["podIP"])
                chain = f"{way}_{address.replace('.', '_')}"
                chains[chain] = [*rules, "drop"]
                jumps[way].append(f"{address} : jump {chain}")
    # Only answers pass unchecked: a later policy also ends connections that were allowed until then.
    forward = [
        "type filter hook forward priority -5; policy accept",
        "ct state established,related ct direction reply accept",
    ]
    forward += [f"ip saddr vmap {{ {', '.join(jumps['out'])} }}"] if jumps["out"] else []
    forward += [f"ip daddr vmap {{ {', '.join(jumps['in'])} }}"] if jumps["in"] else []
    body = "".join(_chain(name, rules) for name, rules in {**chains, "forward": forward}.items())
    return f"{removal()}table inet {TABLE} {{\n{body}}}\n"


def removal() -> str:
    """Return rules that remove all of ours, whether there are any or not."""
    return f"add table inet {TABLE}\ndelete table inet {TABLE}\n"


def in_force(place: str) -> bool:
    """Return whether rules of ours are loaded in a network namespace."""
    return f"table inet {TABLE}\n" in netns.run("nft", "list", "tables", netns=place)


def selects(selector: Object, labels: Mapping[str, str]) -> bool:
    """Return whether a label selector selects these labels; an empty one selects everything."""
    if any(labels.get(key) != value for key, value in (selector.get("matchLabels") or {}).items()):
        return False
    return all(_holds(each, labels) for each in selector.get("matchExpressions") or [])


def _holds(expression: Object, labels: Mapping[str, str]) -> bool:
    key, values = expression["key"], expression.get("values") or []
    match expression["operator"]:
        case "In":
            return labels.get(key) in values
        case "NotIn":
            return labels.get(key) not in values
        case "Exists":
            return key in labels
        case _:  # DoesNotExist
            return key not in labels


def _has_address(pod: Object) -> bool:
    over = pod["status"].get("phase") in ("Succeeded", "Failed")
    return bool(pod["status"].get("podIP")) and not pod["spec"].get("hostNetwork") and not over


def _rules(
    way: str, pod: Object, policies: Sequence[Object], pods: Sequence[Object], namespaces: Mapping[str, Any]
) -> list[str] | None:
    """Return what is allowed for one pod in one direction; None when no policy restricts it."""
    kind, section = ("Ingress", "ingress") if way == "in" else ("Egress", "egress")
    found: list[str] | None = None
    for policy in policies:
        spec = policy["spec"]
        if policy["metadata"]["namespace"] != pod["metadata"]["namespace"] or kind not in _types(spec):
            continue
        if not selects(spec.get("podSelector") or {}, pod["metadata"].get("labels", {})):
            continue
        found = [] if found is None else found
        for rule in spec.get(section) or []:
            peers = _peers(way, rule, policy["metadata"]["namespace"], pods, namespaces)
            for peer in peers:
                found += [" ".join(filter(None, (peer, ports, "return"))) for ports in _ports(way, rule, pod)]
    return found


def _types(spec: Object) -> Sequence[str]:
    return spec.get("policyTypes") or (["Ingress", "Egress"] if spec.get("egress") else ["Ingress"])


def _peers(way: str, rule: Object, own: str, pods: Sequence[Object], namespaces: Mapping[str, Any]) -> Iterator[str]:
    """Yield conditions on the other end, one of which must hold."""
    peers = rule.get("from" if way == "in" else "to") or []
    where = f"ip {_ADDRESS[way]}"
    if not peers:
        yield ""
        return
    addresses = set()
    for peer in peers:
        if block := peer.get("ipBlock"):
            besides = ", ".join(block.get("except") or [])
            yield f"{where} {block['cidr']}" + (f" {where} != {{ {besides} }}" if besides else "")
        else:
            addresses |= set(_selected(peer, own, pods, namespaces))
    if addresses:
        yield f"{where} {{ {', '.join(sorted(addresses))} }}"


def _selected(peer: Object, own: str, pods: Sequence[Object], namespaces: Mapping[str, Any]) -> Iterator[str]:
    for pod in pods:
        namespace = pod["metadata"]["namespace"]
        if "namespaceSelector" in peer:
            right = selects(peer["namespaceSelector"] or {}, namespaces.get(namespace, {}))
        else:
            right = namespace == own
        if right and selects(peer.get("podSelector") or {}, pod["metadata"].get("labels", {})):
            yield str(pod["status"]["podIP"])


def _ports(way: str, rule: Object, pod: Object) -> Iterator[str]:
    """Yield conditions on the port, one of which must hold."""
    ports = rule.get("ports") or []
    if not ports:
        yield ""
    for each in ports:
        protocol = str(each.get("protocol", "TCP")).lower()
        number = each.get("port")
        if isinstance(number, str):
            number = _named(pod, number) if way == "in" else None
            if number is None:
                continue
        if number is None:
            yield f"meta l4proto {protocol}"
        else:
            yield f"{protocol} dport {number}" + (f"-{each['endPort']}" if "endPort" in each else "")


def _named(pod: Object, name: str) -> int | None:
    for container in pod["spec"]["containers"]:
        for port in container.get("ports") or []:
            if port.get("name") == name:
                return int(port["containerPort"])
    return None


def _chain(name: str, rules: Sequence[str]) -> str:
    lines = "".join(f"    {rule}\n" for rule in rules)
    return f"  chain {name} {{\n{lines}  }}\n"
