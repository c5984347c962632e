"""Whether a host is reached without the environment's proxy: NO_PROXY as kubectl reads it.

Python itself reads only names and suffixes. In clusters NO_PROXY is mostly networks.
"""

from __future__ import annotations

import ipaddress
import urllib.request


def wanted(host: str) -> bool:
    """Return whether requests to a host go through a proxy of the environment.

    Args:
        host: a name or an address, without port and brackets.
    """
    named = urllib.request.getproxies_environment()
    if not named.keys() - {"no"}:
        return False
    by_name = urllib.request.proxy_bypass_environment(host, named)  # type: ignore[attr-defined]  # typeshed lacks it
    return not (by_name or _in_network(host, named.get("no", "")))


def _in_network(host: str, exceptions: str) -> bool:
    """Return whether a host is an address in one of the networks of NO_PROXY."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    for entry in exceptions.split(","):
        try:
            if address in ipaddress.ip_network(entry.strip(), strict=False):
                return True
        except ValueError:
            continue  # a name
    return False
