"""Which API server to use, and as whom: a kubeconfig as kubectl reads it, or the pod's own service account.

The only module beside `client` that knows the official client.
"""

from __future__ import annotations

import logging
import os
import ssl
import urllib.parse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml
from kubernetes.aio import config
from kubernetes.aio.client import Configuration
from kubernetes.aio.client.rest import RESTClientObject
from kubernetes.aio.config.config_exception import ConfigException

from robot_offload.kube import proxies
from robot_offload.kube.client import Client, Guard
from robot_offload.kube.errors import NotConfiguredError
from robot_offload.kube.port import FIELD_MANAGER
from robot_offload.kube.retry import RetryPolicy


@dataclass(frozen=True, slots=True)
class Access:
    """The source of the credentials.

    Attributes:
        kubeconfig: a file (or several, as in KUBECONFIG); None: KUBECONFIG, then the pod, then ~/.kube/config.
        context: a context of the kubeconfig; None: the current one.
    """

    kubeconfig: str | None = None
    context: str | None = None

    @property
    def in_cluster(self) -> bool:
        """Whether the pod's service account is used."""
        return not (self.kubeconfig or self.context or os.environ.get("KUBECONFIG")) and bool(
            os.environ.get("KUBERNETES_SERVICE_HOST")
        )

    @property
    def files(self) -> str:
        """The kubeconfig files, separated as in KUBECONFIG."""
        return self.kubeconfig or os.environ.get("KUBECONFIG") or str(Path.home() / ".kube" / "config")


def connect(
    kubeconfig: str | None = None,
    context: str | None = None,
    retry: RetryPolicy | None = None,
    guard: Guard | None = None,
    manager: str = FIELD_MANAGER,
) -> Client:
    """Return a client for an API server. Credentials are read at the first request and again after a 401.

    Args:
        kubeconfig: as `kubectl --kubeconfig`.
        context: as `kubectl --context`.
        retry: how patient requests are.
        guard: called before each request; an exception prevents it.
        manager: field manager for server-side apply.
    """
    access = Access(kubeconfig, context)

    async def configure() -> Configuration:
        return await _configuration(access)

    return Client(configure, retry, guard, manager)


@dataclass(frozen=True, slots=True)
class Credentials:
    """Credentials for another HTTP client of the same API server.

    Attributes:
        server: address, e.g. https://10.0.0.1:443.
        headers: sent with each request; they identify us unless a certificate does.
        tls: trust, and our certificate.
        trust_env: whether to use proxies of the environment.
        proxy: address of a proxy in the kubeconfig; None: there is none.
    """

    server: str
    headers: Mapping[str, str]
    tls: ssl.SSLContext
    trust_env: bool
    proxy: str | None


async def credentials(kubeconfig: str | None = None, context: str | None = None) -> Credentials:
    """Read the configured credentials anew: tokens in a cluster are replaced while a process runs.

    Args:
        kubeconfig: as `kubectl --kubeconfig`.
        context: as `kubectl --context`.

    Raises:
        NotConfiguredError: there is no usable configuration.
    """
    configuration = await _configuration(Access(kubeconfig, context))
    token = await configuration.get_api_key_with_prefix("BearerToken")
    if not token and configuration.username:
        token = configuration.get_basic_auth_token()
    return Credentials(
        server=str(configuration.host),
        headers={"Authorization": token} if token else {},
        tls=RESTClientObject(configuration).ssl_context,
        trust_env=bool(configuration.client_session_kwargs["trust_env"]),
        proxy=configuration.proxy or None,
    )


def current_namespace(kubeconfig: str | None = None, context: str | None = None) -> str:
    """Return the namespace of a command without `-n`: the context's, or `default`."""
    access = Access(kubeconfig, context)
    if access.in_cluster:
        own = Path("/var/run/secrets/kubernetes.io/serviceaccount/namespace")
        return own.read_text(encoding="utf-8").strip() if own.exists() else "default"
    wanted = context
    for name in access.files.split(os.pathsep):
        path = Path(name)
        if not path.is_file():
            continue
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        wanted = wanted or content.get("current-context")
        for entry in content.get("contexts") or ():
            if entry.get("name") == wanted:
                return str((entry.get("context") or {}).get("namespace") or "default")
    return "default"


async def _configuration(access: Access) -> Configuration:
    configuration = Configuration()
    # aiohttp opens as many connections as needed at once; the limit protects the server from a burst.
    configuration.connection_pool_maxsize = 32
    try:
        if access.in_cluster:
            config.load_incluster_config(configuration)
        else:
            with _errors_logged() as errors:
                await config.load_kube_config(
                    access.files, context=access.context, client_configuration=configuration, persist_config=False
                )
            if errors and not (configuration.api_key or configuration.cert_file):
                raise NotConfiguredError(
                    f"the kubeconfig's user has no credentials: {errors[0]}. Its program (users[].user.exec) must be "
                    "on PATH and end well: kubectl get --raw /version runs it as well"
                )
    except ConfigException as error:
        raise NotConfiguredError(
            f"no cluster to talk to: {error}. Name one with --kubeconfig or KUBECONFIG, or check --context"
        ) from error
    # Without a proxy aiohttp would still look for a .netrc, in a thread, at each request.
    host = urllib.parse.urlsplit(configuration.host).hostname or ""
    configuration.client_session_kwargs = {"trust_env": proxies.wanted(host)}
    return configuration


@contextmanager
def _errors_logged() -> Iterator[list[str]]:
    """Collect what the official client only logs: that a user's program is missing or has failed."""
    found: list[str] = []

    def take(record: logging.LogRecord) -> bool:
        if record.levelno >= logging.ERROR:
            found.append(record.getMessage())
        return record.levelno < logging.ERROR

    log = logging.getLogger("kubernetes.aio.config.kube_config")
    log.addFilter(take)
    try:
        yield found
    finally:
        log.removeFilter(take)
