"""Shared by all commands that talk to a cluster: options as in kubectl, one connection, objects by name."""

from __future__ import annotations

import asyncio
import difflib
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypeVar

import typer

from robot_offload.api.agent_state import AgentState, StateError, parse_state
from robot_offload.errors import InputError, RobotOffloadError
from robot_offload.kube.configuration import connect, current_namespace
from robot_offload.kube.errors import KubeError, NotFoundError
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.pages import REPORTER_PORT, answered, proxied, read_page
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.kube.retry import RetryPolicy
from robot_offload.objects.names import AGENT, child_name

Result = TypeVar("Result")

Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the RobotOffload.")]
Kubeconfig = Annotated[
    str | None, typer.Option("--kubeconfig", metavar="FILE", help="As kubectl's. Default: KUBECONFIG, ~/.kube/config.")
]
Context = Annotated[str | None, typer.Option("--context", metavar="NAME", help="Context of the kubeconfig.")]
Namespace = Annotated[
    str | None, typer.Option("--namespace", "-n", metavar="NAME", help="Namespace. Default: the context's.")
]

FIELD_MANAGER: Final = "kubectl-offload"
"""Field manager of a pin set by hand, as opposed to the operator's."""
INSTALL: Final = "helm install robot-offload charts/robot-offload --namespace robot-offload-system --create-namespace"
NO_KIND: Final = f"the cluster does not know RobotOffload; install it first: {INSTALL}"
PATIENCE: Final = RetryPolicy(attempts=2, request_timeout_s=10.0)
"""The user waits at the terminal: prefer an early error to a late answer."""
HURRY: Final = RetryPolicy(attempts=1, request_timeout_s=3.0)
"""For the live numbers, which are welcome but not needed."""


@dataclass(frozen=True, slots=True)
class Target:
    """The cluster and namespace of a command.

    Attributes:
        kubeconfig: as `kubectl --kubeconfig`.
        context: as `kubectl --context`.
        given_namespace: as `kubectl --namespace`.
    """

    kubeconfig: str | None = None
    context: str | None = None
    given_namespace: str | None = None

    @property
    def namespace(self) -> str:
        """The namespace given, or else the kubeconfig's."""
        return self.given_namespace or current_namespace(self.kubeconfig, self.context)

    @asynccontextmanager
    async def api(self, retry: RetryPolicy = PATIENCE) -> AsyncIterator[KubeApi]:
        """Provide a connection that is closed at the end of the block."""
        api = connect(self.kubeconfig, self.context, retry, manager=FIELD_MANAGER)
        try:
            yield api
        finally:
            await api.close()

    def run(self, work: Callable[[KubeApi], Coroutine[Any, Any, Result]]) -> Result:
        """Run `work` with a connection."""

        async def whole() -> Result:
            async with self.api() as api:
                return await work(api)

        return asyncio.run(whole())


async def find(api: KubeApi, namespace: str, name: str) -> Manifest:
    """Return the RobotOffload of this name.

    Raises:
        InputError: it does not exist; the message lists those that do.
        KubeError: the API server refuses or does not answer.
    """
    found = await api.get(ROBOT_OFFLOAD, namespace, name)
    if found is not None:
        return found
    known = [other["metadata"]["name"] for other in await find_all(api, namespace)]
    raise InputError(missing(name, namespace, known))


async def find_all(api: KubeApi, namespace: str | None) -> list[Manifest]:
    """Return all RobotOffloads of a namespace, or of all.

    Raises:
        RobotOffloadError: the cluster does not know the kind.
    """
    try:
        found = await api.list(ROBOT_OFFLOAD, namespace)
    except NotFoundError as error:
        raise RobotOffloadError(NO_KIND) from error
    return sorted(found, key=lambda each: (each["metadata"]["namespace"], each["metadata"]["name"]))


def missing(name: str, namespace: str, known: list[str]) -> str:
    """Return the message for a RobotOffload that does not exist."""
    problem = f"there is no RobotOffload {name} in namespace {namespace}"
    close = difflib.get_close_matches(name, known, n=1)
    if close:
        return f"{problem}; did you mean {close[0]}?"
    if known:
        return f"{problem}; there is {', '.join(sorted(known)[:10])}"
    return f"{problem}, and no other either; kubectl get roff --all-namespaces shows where they are"


@dataclass(frozen=True, slots=True)
class Live:
    """The live state of a cloud agent.

    Attributes:
        state: what the agent reports; None: it could not be asked.
        problem: why it could not be asked; empty: it could.
    """

    state: AgentState | None = None
    problem: str = ""


async def live(api: KubeApi, namespace: str, name: str) -> Live:
    """Ask the reporter of a RobotOffload through the API server's proxy."""
    url = proxied(namespace, child_name(name, AGENT), REPORTER_PORT, "state")
    try:
        answer = await read_page(api, url)
        return Live(parse_state(json.dumps(answer))) if answer else Live(problem="there is no cloud agent")
    except KubeError as error:
        return Live(problem=answered(error))
    except StateError as error:
        return Live(problem=str(error))
