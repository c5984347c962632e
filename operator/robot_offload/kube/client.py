"""The adapter to the official asynchronous client; nothing else imports `kubernetes`.

Objects stay plain dicts in both directions, and our kinds are known, so neither its models nor its discovery is used.
Nor is its dynamic client, which formats a traceback for each missing object.
"""

from __future__ import annotations

import asyncio
import json
import random
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from http import HTTPStatus
from typing import Any, Final, TypeAlias

import aiohttp
from kubernetes.aio.client import ApiClient, Configuration

from robot_offload.kube.errors import (
    KubeError,
    NotFoundError,
    SilentError,
    UnauthorizedError,
    UnreachableError,
    error_of,
)
from robot_offload.kube.kinds import Kind, kind_of
from robot_offload.kube.port import FIELD_MANAGER, METADATA, METADATA_LIST, Change, Manifest, Selection, Verb
from robot_offload.kube.retry import RetryPolicy

_JSON: Final = "application/json"
_MERGE_PATCH: Final = "application/merge-patch+json"
_APPLY_PATCH: Final = "application/apply-patch+yaml; charset=utf-8"
"""With a parameter, so that the official client sends our bytes unchanged: its JSON escapes are not always YAML."""
_CHANGES: Final = frozenset({"ADDED", "MODIFIED", "DELETED", "BOOKMARK"})
_WATCH_S: Final = (300, 600)
"""How long the API server keeps a watch open, as in client-go: random, so that not all end together."""
_NOT_IN_YAML: Final = re.compile("[\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")
_PAGE: Final = 500
"""Objects per page of a list: bounds the memory of one answer."""

Configure: TypeAlias = Callable[[], Awaitable[Configuration]]
"""Reads the credentials (again)."""
Guard: TypeAlias = Callable[[Verb], None]
"""Called before each request; an exception prevents the request."""


class Client:
    """`KubeApi` over HTTP. Create it with `connect`, end it with `close`."""

    def __init__(
        self,
        configure: Configure,
        retry: RetryPolicy | None = None,
        guard: Guard | None = None,
        manager: str = FIELD_MANAGER,
    ) -> None:
        self._configure = configure
        self._manager = manager
        self._guard = guard or _let_pass
        self._retry = retry or RetryPolicy()
        self._http: ApiClient | None = None
        self._opening = asyncio.Lock()

    async def get(self, kind: Kind, namespace: str | None, name: str) -> Manifest | None:
        """See `KubeApi.get`."""
        self._guard("get")
        try:
            return await self._send("get", kind.path(namespace, name), f"get {_told(kind, namespace, name)}")
        except NotFoundError:
            return None

    async def list(
        self, kind: Kind, namespace: str | None = None, labels: Mapping[str, str] | None = None
    ) -> list[Manifest]:
        """See `KubeApi.list`."""
        self._guard("list")
        selector = ",".join(f"{key}={value}" for key, value in sorted((labels or {}).items()))
        return [item async for page, _ in self._pages(kind, namespace, Selection(selector)) for item in page]

    async def pages(
        self, kind: Kind, namespace: str | None, selection: Selection
    ) -> AsyncIterator[tuple[Sequence[Manifest], str]]:
        """See `KubeApi.pages`."""
        self._guard("list")
        async for page in self._pages(kind, namespace, selection):
            yield page

    async def _pages(
        self, kind: Kind, namespace: str | None, selection: Selection
    ) -> AsyncIterator[tuple[Sequence[Manifest], str]]:
        token: str | None = None
        while True:
            answer = await self._send(
                "get",
                kind.path(namespace),
                f"list {kind.plural}{f' in {namespace}' if namespace else ''}",
                _asked(selection, METADATA_LIST).with_query(limit=_PAGE, **{"continue": token}),
            )
            # Items of a list have no apiVersion and kind, or those of the requested form.
            own = {"apiVersion": kind.api_version, "kind": kind.kind}
            metadata = answer.get("metadata") or {}
            yield [{**item, **own} for item in answer.get("items") or ()], str(metadata.get("resourceVersion") or "")
            token = metadata.get("continue") or None
            if token is None:
                return

    async def watch(
        self, kind: Kind, namespace: str | None, selection: Selection, version: str, *, idle_s: float
    ) -> AsyncIterator[Change]:
        """See `KubeApi.watch`."""
        self._guard("watch")
        doing = f"watch {kind.plural}{f' in {namespace}' if namespace else ''}"
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=self._retry.request_timeout_s, sock_read=idle_s)
        asked = _asked(selection, METADATA).with_query(
            watch="true",
            resourceVersion=version,
            allowWatchBookmarks="true",
            timeoutSeconds=random.randint(*_WATCH_S),
        )
        async for line in self._lines(kind.path(namespace), doing, timeout, asked):
            try:
                change = _change(json.loads(line), kind, doing)
            except ValueError as error:
                raise UnreachableError(f"cannot {doing}: {error}") from error
            if change is not None:
                yield change

    async def lines(self, path: str, *, idle_s: float) -> AsyncIterator[bytes]:
        """See `KubeApi.lines`."""
        self._guard("get")
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=self._retry.request_timeout_s, sock_read=idle_s)
        async for line in self._lines(path, f"follow {path}", timeout, _Asked()):
            yield line

    async def _lines(
        self, path: str, doing: str, timeout: aiohttp.ClientTimeout, asked: _Asked
    ) -> AsyncIterator[bytes]:
        silent = f"cannot {doing}: silent for {timeout.sock_read:g} s"
        try:
            answer = await self._request("get", path, doing, timeout, asked)
        except UnreachableError as error:
            if isinstance(error.__cause__, TimeoutError):
                raise SilentError(silent) from error
            raise
        try:
            while line := await answer.content.readline():
                yield line
        except TimeoutError as error:
            raise SilentError(silent) from error
        except (aiohttp.ClientError, OSError, ValueError) as error:
            raise UnreachableError(f"cannot {doing}: {error or type(error).__name__}") from error
        finally:
            _cut(answer)

    async def apply(self, manifest: Manifest, *, force: bool = False) -> Manifest:
        """See `KubeApi.apply`."""
        self._guard("apply")
        kind, namespace, name = _address(manifest)
        return await self._send(
            "patch",
            kind.path(namespace, name),
            f"apply {_told(kind, namespace, name)}",
            _Asked({"fieldManager": self._manager, "force": "true" if force else None}, _yaml(manifest), _APPLY_PATCH),
        )

    async def create(self, manifest: Manifest) -> Manifest:
        """See `KubeApi.create`."""
        self._guard("create")
        kind, namespace, name = _address(manifest)
        return await self._send(
            "post",
            kind.path(namespace),
            f"create {_told(kind, namespace, name)}",
            _Asked({"fieldManager": self._manager}, manifest),
            idempotent=False,
        )

    async def patch(
        self, kind: Kind, namespace: str | None, name: str, patch: Mapping[str, Any], *, subresource: str = ""
    ) -> Manifest:
        """See `KubeApi.patch`."""
        self._guard("patch")
        return await self._patch(kind, namespace, name, patch, subresource)

    async def _patch(
        self, kind: Kind, namespace: str | None, name: str, patch: Mapping[str, Any], subresource: str
    ) -> Manifest:
        return await self._send(
            "patch",
            kind.path(namespace, name, subresource),
            f"patch {_told(kind, namespace, name)}",
            _Asked({"fieldManager": self._manager}, dict(patch), _MERGE_PATCH),
        )

    async def delete(self, kind: Kind, namespace: str | None, name: str, uid: str) -> None:
        """See `KubeApi.delete`."""
        self._guard("delete")
        options = {"propagationPolicy": "Background", "preconditions": {"uid": uid}}
        try:
            await self._send(
                "delete",
                kind.path(namespace, name),
                f"delete {_told(kind, namespace, name)}",
                _Asked(body=options),
            )
        except NotFoundError:
            return

    async def patch_status(self, manifest: Manifest) -> Manifest:
        """See `KubeApi.patch_status`."""
        self._guard("patch status")
        kind, namespace, name = _address(manifest)
        metadata = {key: manifest["metadata"][key] for key in ("uid", "resourceVersion") if key in manifest["metadata"]}
        return await self._patch(kind, namespace, name, {"metadata": metadata, "status": manifest["status"]}, "status")

    async def close(self) -> None:
        """See `KubeApi.close`."""
        http, self._http = self._http, None
        if http is not None:
            await http.close()

    async def _send(
        self, method: str, path: str, doing: str, asked: _Asked | None = None, *, idempotent: bool = True
    ) -> Manifest:
        """Send a request, repeat it if that may help, and return the object in the answer."""
        attempt, renewed = 1, False
        while True:
            try:
                return await self._send_once(method, path, doing, asked or _Asked())
            except UnauthorizedError:
                # Tokens in a cluster are replaced while we run: read them again, once.
                if renewed:
                    raise
                renewed = True
                await self.close()
            except KubeError as error:
                pause_s = self._retry.pause_s(error, attempt, idempotent=idempotent)
                if pause_s is None:
                    raise
                attempt += 1
                await asyncio.sleep(pause_s)

    async def _send_once(self, method: str, path: str, doing: str, asked: _Asked) -> Manifest:
        timeout = aiohttp.ClientTimeout(total=self._retry.request_timeout_s)
        answer = await self._request(method, path, doing, timeout, asked)
        body = await self._read(answer, doing)
        try:
            value = json.loads(body)
        except ValueError as error:
            raise UnreachableError(
                f"cannot {doing}: the answer is not JSON; is something else at that address?"
            ) from error
        return value if isinstance(value, dict) else {}

    async def _request(
        self, method: str, path: str, doing: str, timeout: aiohttp.ClientTimeout, asked: _Asked
    ) -> aiohttp.ClientResponse:
        """Send a request once; return an answer whose content is still to be read."""
        http = await self._open()
        query = [(name, str(value)) for name, value in asked.query.items() if value is not None]
        headers = {"Accept": asked.accept, "Content-Type": asked.content_type}
        try:
            request = await http.param_serialize(
                method.upper(),
                path,
                query_params=query,
                header_params=headers,
                body=asked.body,
                auth_settings=["BearerToken"],
            )
            response = await http.call_api(*request, _request_timeout=timeout)
        except TimeoutError as error:
            raise UnreachableError(f"cannot {doing}: no answer within {self._retry.request_timeout_s:g} s") from error
        except (aiohttp.ClientError, OSError) as error:
            raise UnreachableError(f"cannot {doing}: {error or type(error).__name__}") from error
        answer: aiohttp.ClientResponse = response.response
        if answer.status >= HTTPStatus.MULTIPLE_CHOICES:
            text = (await self._read(answer, doing)).decode(errors="replace")
            raise error_of(answer.status, text, dict(answer.headers), doing)
        return answer

    async def _read(self, answer: aiohttp.ClientResponse, doing: str) -> bytes:
        try:
            return await answer.read()
        except TimeoutError as error:
            raise UnreachableError(f"cannot {doing}: no answer within {self._retry.request_timeout_s:g} s") from error
        except (aiohttp.ClientError, OSError) as error:
            raise UnreachableError(f"cannot {doing}: {error or type(error).__name__}") from error

    async def _open(self) -> ApiClient:
        async with self._opening:
            if self._http is None:
                self._http = ApiClient(await self._configure())
            return self._http


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request without its path.

    Attributes:
        query: parameters by name; None: not sent.
        body: the object to send, or its text; None: nothing.
        content_type: of the body.
        accept: the form of the answer.
    """

    query: Mapping[str, object] = field(default_factory=dict)
    body: Manifest | bytes | None = None
    content_type: str = _JSON
    accept: str = _JSON

    def with_query(self, **more: object) -> _Asked:
        """Return the same with further parameters."""
        return replace(self, query={**self.query, **more})


def _yaml(manifest: Manifest) -> bytes:
    """Return an object as JSON that is also YAML.

    JSON escapes a character beyond U+FFFF as two surrogates, which YAML refuses; YAML requires some other characters to
    be escaped.
    """
    text = json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))
    return _NOT_IN_YAML.sub(lambda found: f"\\u{ord(found[0]):04x}", text).encode()


def _cut(answer: aiohttp.ClientResponse) -> None:
    """End the connection of an answer at once: over TLS `close` alone waits for the server's close."""
    connection = answer.connection
    transport = connection.transport if connection is not None else None
    answer.close()
    if transport is not None:
        transport.abort()


def _asked(selection: Selection, form: str) -> _Asked:
    """Turn a selection into a request; `form` is the Accept header for metadata alone."""
    query = {"labelSelector": selection.labels or None, "fieldSelector": selection.fields or None}
    return _Asked(query, accept=form if selection.metadata_only else _JSON)


def _change(event: Any, kind: Kind, doing: str) -> Change | None:
    """Parse an event of a watch; None: of an unknown type."""
    manifest = event["object"]
    if event["type"] == "ERROR":
        raise error_of(int(manifest.get("code") or 500), json.dumps(manifest), {}, doing)
    if event["type"] not in _CHANGES:
        return None
    own = {"apiVersion": kind.api_version, "kind": kind.kind}
    return Change(event["type"], {**manifest, **own}, str(manifest["metadata"]["resourceVersion"]))


def _let_pass(verb: Verb) -> None:
    """Guard nothing."""


def _address(manifest: Manifest) -> tuple[Kind, str | None, str]:
    metadata = manifest["metadata"]
    return kind_of(manifest), metadata.get("namespace"), metadata["name"]


def _told(kind: Kind, namespace: str | None, name: str) -> str:
    return f"{kind.kind} {namespace}/{name}" if namespace else f"{kind.kind} {name}"
