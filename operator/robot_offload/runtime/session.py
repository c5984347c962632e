"""kopf's HTTP session with the API server.

It adds three things for which kopf has no setting: Secrets are listed and watched as metadata, so that no key comes
into this process; a list without items is an empty list; and each request is counted, and writes are refused unless
this process leads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, cast

import aiohttp
import kopf

from robot_offload.kube.configuration import Credentials
from robot_offload.kube.port import METADATA, METADATA_LIST, Verb

_WRITES: Final = {"POST": "create", "PATCH": "patch", "PUT": "patch", "DELETE": "delete"}


class Answer(aiohttp.ClientResponse):
    """An answer as kopf reads it: API servers send an empty list of metadata as `items: null`."""

    async def json(self, **how: Any) -> Any:
        """See `ClientResponse.json`."""
        value = await super().json(**how)
        if isinstance(value, dict) and value.get("items", ()) is None:
            value["items"] = []
        return value


def session(
    credentials: Credentials, guard: Callable[[Verb], None], opened: Callable[[str], None]
) -> kopf.AiohttpSession:
    """Return a session.

    Args:
        credentials: which API server, and as whom.
        guard: called before each request; an exception prevents it.
        opened: called with the path of a collection whenever a stream of it is requested.
    """

    async def between(request: aiohttp.ClientRequest, send: aiohttp.ClientHandlerType) -> aiohttp.ClientResponse:
        path, watch = request.url.path, request.url.query.get("watch") == "true"
        guard(cast("Verb", _WRITES.get(request.method, "watch" if watch else "list")))
        if path.endswith("/secrets"):
            request.headers["Accept"] = METADATA if watch else METADATA_LIST
        if watch:
            opened(path)  # also without an answer: a silent stream may have lost events
        return await send(request)

    http = aiohttp.ClientSession(
        connector=aiohttp.TCPConnector(limit=0, ssl=credentials.tls),
        headers=credentials.headers,
        middlewares=(between,),
        response_class=Answer,
        proxy=credentials.proxy,
        trust_env=credentials.trust_env,
    )
    return kopf.AiohttpSession(server=credentials.server, aiohttp_session=http)
