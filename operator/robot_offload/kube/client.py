"""The adapter to the official client's asynchronous dynamic client; nothing else imports `kubernetes`.

Objects stay plain dicts in both directions. The dynamic client's discovery is not used: our kinds are known, and a
request less at the start is one less that can fail.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final, TypeAlias

import aiohttp
from kubernetes.aio.client import ApiClient, Configuration
from kubernetes.aio.client.exceptions import ApiException
from kubernetes.aio.dynamic import DynamicClient

from robot_offload.kube.errors import KubeError, NotFoundError, UnauthorizedError, UnreachableError, error_of
from robot_offload.kube.kinds import Kind, kind_of
from robot_offload.kube.port import FIELD_MANAGER, Manifest, Verb
from robot_offload.kube.retry import RetryPolicy

_MERGE_PATCH: Final = "application/merge-patch+json"
_APPLY_PATCH: Final = "application/apply-patch+yaml"
_PAGE: Final = 500
"""Objects per answer of a list: bounds what one answer holds in memory."""

Configure: TypeAlias = Callable[[], Awaitable[Configuration]]
"""Reads the credentials (again)."""
Guard: TypeAlias = Callable[[Verb], None]
"""Is called before each request; what it raises keeps the request from being sent."""


class Client:
    """`KubeApi` over HTTP. Make it with `connect`, end it with `close`."""

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
        self._dynamic: DynamicClient | None = None
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
        found: list[Manifest] = []
        token: str | None = None
        while True:
            answer = await self._send(
                "get",
                kind.path(namespace),
                f"list {kind.plural}{f' in {namespace}' if namespace else ''}",
                label_selector=selector or None,
                limit=_PAGE,
                _continue=token,
            )
            # Items of a list carry neither apiVersion nor kind.
            found += [{"apiVersion": kind.api_version, "kind": kind.kind, **item} for item in answer.get("items") or ()]
            token = answer.get("metadata", {}).get("continue") or None
            if token is None:
                return found

    async def apply(self, manifest: Manifest, *, force: bool = False) -> Manifest:
        """See `KubeApi.apply`."""
        self._guard("apply")
        kind, namespace, name = _address(manifest)
        return await self._send(
            "patch",
            kind.path(namespace, name),
            f"apply {_told(kind, namespace, name)}",
            body=manifest,
            content_type=_APPLY_PATCH,
            field_manager=self._manager,
            force_conflicts="true" if force else None,
        )

    async def create(self, manifest: Manifest) -> Manifest:
        """See `KubeApi.create`."""
        self._guard("create")
        kind, namespace, name = _address(manifest)
        return await self._send(
            "post",
            kind.path(namespace),
            f"create {_told(kind, namespace, name)}",
            idempotent=False,
            body=manifest,
            field_manager=self._manager,
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
            body=dict(patch),
            content_type=_MERGE_PATCH,
            field_manager=self._manager,
        )

    async def delete(self, kind: Kind, namespace: str | None, name: str, uid: str) -> None:
        """See `KubeApi.delete`."""
        self._guard("delete")
        options = {"propagationPolicy": "Background", "preconditions": {"uid": uid}}
        try:
            await self._send(
                "delete", kind.path(namespace, name), f"delete {_told(kind, namespace, name)}", body=options
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
        dynamic, self._dynamic = self._dynamic, None
        if dynamic is not None:
            await dynamic.client.close()

    async def _send(
        self, method: str, path: str, doing: str, *, idempotent: bool = True, **parameters: Any
    ) -> Manifest:
        """Sends a request, again where that can help, and returns the object in the answer."""
        attempt, renewed = 1, False
        while True:
            try:
                return await self._send_once(method, path, doing, parameters)
            except UnauthorizedError:
                # Tokens in a cluster are replaced while we run: read them anew, once.
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

    async def _send_once(self, method: str, path: str, doing: str, parameters: dict[str, Any]) -> Manifest:
        dynamic = await self._open()
        timeout = aiohttp.ClientTimeout(total=self._retry.request_timeout_s)
        try:
            answer = await dynamic.request(
                method, path, serialize=False, query_params=[], header_params={}, _request_timeout=timeout, **parameters
            )
            body = await answer.read()
        except ApiException as error:
            raise error_of(error.status or 0, _text(error.body), dict(error.headers or {}), doing) from error
        except TimeoutError as error:
            raise UnreachableError(f"cannot {doing}: no answer within {self._retry.request_timeout_s:g} s") from error
        except (aiohttp.ClientError, OSError) as error:
            raise UnreachableError(f"cannot {doing}: {error or type(error).__name__}") from error
        try:
            value = json.loads(body)
        except ValueError as error:
            raise UnreachableError(
                f"cannot {doing}: the answer is not JSON; is something else at that address?"
            ) from error
        return value if isinstance(value, dict) else {}

    async def _open(self) -> DynamicClient:
        async with self._opening:
            if self._dynamic is None:
                self._dynamic = DynamicClient(ApiClient(await self._configure()))
            return self._dynamic


def _let_pass(verb: Verb) -> None:
    """Guards nothing."""


def _address(manifest: Manifest) -> tuple[Kind, str | None, str]:
    metadata = manifest["metadata"]
    return kind_of(manifest), metadata.get("namespace"), metadata["name"]


def _told(kind: Kind, namespace: str | None, name: str) -> str:
    return f"{kind.kind} {namespace}/{name}" if namespace else f"{kind.kind} {name}"


def _text(body: object) -> str:
    return body.decode(errors="replace") if isinstance(body, bytes) else str(body or "")
