"""The operator as a process: settings from the environment, log lines, an exit code."""

from __future__ import annotations

import asyncio
import os
import sys
from typing import Any, cast

import kopf
import structlog

from robot_offload.errors import RobotOffloadError
from robot_offload.kube.configuration import connect
from robot_offload.kube.retry import RetryPolicy
from robot_offload.runtime import logs
from robot_offload.runtime.leadership import Leadership, LeadersOnly, Terms
from robot_offload.runtime.operator import Operator, PartEndedError
from robot_offload.runtime.settings import Settings, from_environment

_log = structlog.get_logger("robot_offload.runtime.process")


def run(registry: kopf.OperatorRegistry) -> int:
    """Run the operator until it is stopped or loses a part; return the exit code of the process.

    Args:
        registry: kopf's handlers.
    """
    try:
        settings = from_environment(os.environ)
    except RobotOffloadError as error:
        print("\n".join(error.lines), file=sys.stderr)  # noqa: T201
        return error.exit_code
    logs.set_up(settings.log_level, settings.log_format)
    try:
        asyncio.run(_run(settings, registry))
    except RobotOffloadError as error:
        _log.error("Ended", reason=type(error).__name__, error=str(error))
        return 1
    _log.info("Ended")
    return 0


async def _run(settings: Settings, registry: kopf.OperatorRegistry) -> None:
    # A separate connection without patience: renewing must not queue behind the work.
    leader_api = connect(retry=RetryPolicy(attempts=1, request_timeout_s=settings.lease_s / 5))
    lease_s = settings.lease_s
    terms = Terms(duration_s=lease_s, renew_s=lease_s / 3, give_up_s=lease_s * 2 / 3)
    leadership = Leadership(leader_api, settings.pod_namespace, settings.pod_name, terms=terms)
    guard = LeadersOnly(leadership)
    api = connect(retry=RetryPolicy(request_timeout_s=settings.request_s), guard=guard)
    operator = Operator(settings, api, leadership, guard)
    try:
        await kopf.operator(
            registry=registry,
            memo=operator,
            standalone=True,
            clusterwide=not settings.watch_namespaces,
            namespaces=settings.watch_namespaces,
            stop_flag=operator.stop,
            # kopf would ask for the user's name, which a container's user lacks.
            identity=cast(Any, settings.pod_name),
        )
    except Exception as error:
        raise PartEndedError(f"kopf has ended: {error!r}") from error
    finally:
        await api.close()
        await leader_api.close()
    if operator.failure is not None:
        raise operator.failure
