"""Variables: the ROS network, what a read-only root file system needs, and the user's own."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec

FIXED: Final = {
    # The only writable folder if the root file system is read-only.
    "HOME": "/tmp",  # noqa: S108 - of the container alone
    "ROS_LOG_DIR": "/tmp/ros",  # noqa: S108
    "PYTHONDONTWRITEBYTECODE": "1",
    "PYTHONUNBUFFERED": "1",
}
OWNED: Final = {
    **dict.fromkeys(FIXED, "it is fixed"),
    "ROS_DISTRO": "use distro",
    "RMW_IMPLEMENTATION": "use rmw",
    "ROS_DOMAIN_ID": "use environment.domainID",
    "ROS_DISCOVERY_SERVER": "use environment.discoveryServers",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "use environment.discoveryRange",
    "ROS_STATIC_PEERS": "use environment.staticPeers",
    "FASTDDS_BUILTIN_TRANSPORTS": "use environment.fastddsTransports",
    "ROBOT_OFFLOAD_NODE": "use node",
    "ROBOT_OFFLOAD_AUTOSTART": "use autostart",
}
_SECRET: Final = re.compile(r"PASSWORD|PASSWD|SECRET|TOKEN|PRIVATE_KEY|API_?KEY|CREDENTIAL", re.IGNORECASE)


class Environment(Feature[BuildSpec]):
    """The node's environment."""

    name = "environment"
    stages = ("runtime",)
    flags = (
        Flag("--domain-id", "environment.domainID", "ROS_DOMAIN_ID, 0 to 232.", "number", "NUMBER"),
        Flag(
            "--discovery-server",
            "environment.discoveryServers",
            "Fast DDS discovery server HOST:PORT, in the order of their ids; may be repeated.",
            "texts",
            "HOST:PORT",
        ),
        Flag("--discovery-range", "environment.discoveryRange", "Subnet, Localhost or Off (Iron and newer)."),
        Flag(
            "--static-peer",
            "environment.staticPeers",
            "Host to look for nodes on (Iron and newer); may be repeated.",
            "texts",
            "HOST",
        ),
        Flag("--fastdds-transports", "environment.fastddsTransports", "UDPv4, LARGE_DATA, SHM or DEFAULT."),
        Flag("--env", "env", "Further variable of the image, no secret; may be repeated.", "texts", "NAME=VALUE"),
    )

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Refuse a variable that is set twice, owned by another field, or unknown to the distribution."""
        names = [variable.name for variable in spec.env]
        for index, name in enumerate(names):
            path = f"env[{index}].name"
            if name in OWNED:
                yield Finding(path, "Reserved", f"{name} is set by the image; {OWNED[name]}")
            if name in names[:index]:
                yield Finding(path, "Duplicate", f"{name} is there twice")
            if _SECRET.search(name):
                message = f"{name} looks like a secret; everybody who has the image can read it"
                yield Finding(path, "Secret", message, "warning")
        network = spec.environment
        if not spec.release.static_peers and (network.static_peers or network.discovery_range):
            field = "environment.staticPeers" if network.static_peers else "environment.discoveryRange"
            yield Finding(field, "NotSupported", f"{spec.distro} does not know it; it came with Iron")
        if network.static_peers and network.discovery_range == "Off":
            yield Finding("environment.discoveryRange", "NotSupported", "Off would not ask the static peers either")
        for index, peer in enumerate(network.static_peers):
            if ":" in peer:
                path = f"environment.staticPeers[{index}]"
                yield Finding(path, "Invalid", "static peers have no ports; write the host only")

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return all variables in order."""
        network = spec.environment
        variables = {"ROS_DISTRO": spec.distro, "RMW_IMPLEMENTATION": spec.rmw, **FIXED}
        if spec.node:
            variables["ROBOT_OFFLOAD_NODE"] = spec.node
        if spec.autostart:
            variables["ROBOT_OFFLOAD_AUTOSTART"] = "1"
        if network.domain_id is not None:
            variables["ROS_DOMAIN_ID"] = str(network.domain_id)
        if network.discovery_servers:
            variables["ROS_DISCOVERY_SERVER"] = ";".join(network.discovery_servers)
        if network.discovery_range:
            variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] = network.discovery_range.upper()
        if network.static_peers:
            variables["ROS_STATIC_PEERS"] = ";".join(network.static_peers)
        if network.fastdds_transports:
            variables["FASTDDS_BUILTIN_TRANSPORTS"] = network.fastdds_transports
        return {"variables": variables | {variable.name: variable.value for variable in spec.env}}
