"""Pages of the API server beside its objects: its own, and those of Services behind its proxy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Final

from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import Kind
from robot_offload.kube.port import KubeApi, Manifest

REPORTER_PORT: Final = 8080
LONGEST: Final = 160
"""Maximum characters of an answer shown to a person."""


@dataclass(frozen=True, slots=True)
class _Page(Kind):
    """A page at a fixed path of the API server, not an object of a kind."""

    url: str = ""

    def path(self, namespace: str | None, name: str = "", subresource: str = "") -> str:
        """Return the path."""
        return self.url


async def read_page(api: KubeApi, url: str) -> Manifest | None:
    """Read the API server's JSON answer at `url`; None: there is nothing."""
    return await api.get(_Page("", url, "", namespaced=False, url=url), None, "")


def proxied(namespace: str, service: str, port: int, page: str) -> str:
    """Return the API server's proxy path for a page of a Service."""
    return f"/api/v1/namespaces/{namespace}/services/http:{service}:{port}/proxy/{page}"


def answered(error: KubeError) -> str:
    """Return the reporter's own words if it answered, else the API server's."""
    text = str(error)
    if "no endpoints available" in text:
        return "the cloud agent has no ready pod"
    start = text.find('{"problem"')
    if start >= 0:
        try:
            return str(json.loads(text[start : text.rindex("}") + 1])["problem"])
        except (ValueError, KeyError):
            pass
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
