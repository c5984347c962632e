"""Pages that the API server serves beside its objects: its own, and those of Services behind its proxy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Final

from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import Kind
from robot_offload.kube.port import KubeApi, Manifest

REPORTER_PORT: Final = 8080
LONGEST: Final = 160
"""Characters of an answer that a person reads."""


@dataclass(frozen=True, slots=True)
class _Page(Kind):
    """Something that the API server answers at a fixed place and that is no object of a kind."""

    url: str = ""

    def path(self, namespace: str | None, name: str = "", subresource: str = "") -> str:
        """Return the place."""
        return self.url


async def read_page(api: KubeApi, url: str) -> Manifest | None:
    """Return what the API server answers at `url` as JSON; None: there is nothing."""
    return await api.get(_Page("", url, "", namespaced=False, url=url), None, "")


def proxied(namespace: str, service: str, port: int, page: str) -> str:
    """Return where the API server passes on a page of a Service."""
    return f"/api/v1/namespaces/{namespace}/services/http:{service}:{port}/proxy/{page}"


def answered(error: KubeError) -> str:
    """Return the reporter's own words where it has answered, else the API server's."""
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
