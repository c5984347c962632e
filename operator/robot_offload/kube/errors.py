"""What can go wrong between us and the API server, in one tree under `RobotOffloadError`.

KubeError                  the base; `retriable` says whether the same request may succeed later
|- NotConfiguredError      no kubeconfig, no such context, not inside a cluster
|- UnauthorizedError       401: the credentials are not accepted (any more)
|- ForbiddenError          403: a role does not allow it
|- NotFoundError           404: the object, its namespace or its kind is missing
|- ConflictError           409: another client changed the object or owns the field
|  `- AlreadyExistsError   409: the name is taken
|- InvalidObjectError      400, 422 and other refusals of the request itself
|- TooManyError            429: the API server asks to slow down
|- ServerFailedError       5xx: the API server has a problem
`- UnreachableError        no answer in time, or no connection at all
   `- SilentError          a watch that brings nothing, not even bookmarks

NotLeaderError is separate: this process may not write (any more), so nothing is to be retried.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from robot_offload.errors import RobotOffloadError

_UID: Final = "metadata.uid"


class KubeError(RobotOffloadError):
    """The API server refused or did not answer.

    Attributes:
        status: the HTTP status; 0: no answer.
        retry_after_s: seconds after which the server accepts a retry, if it sent them.
        details: causes of a refusal from the server's list: (field, message).
    """

    retriable: ClassVar[bool] = False
    reason: ClassVar[str] = "ApiServerRefused"

    def __init__(
        self,
        message: str,
        *,
        status: int = 0,
        retry_after_s: float | None = None,
        details: tuple[tuple[str, str], ...] = (),
    ) -> None:
        super().__init__(message)
        self.status = status
        self.retry_after_s = retry_after_s
        self.details = details


class NotConfiguredError(KubeError):
    """No API server, or no identity for it, is configured."""

    exit_code = 2
    reason = "NotConfigured"


class UnauthorizedError(KubeError):
    """The credentials are not accepted."""

    retriable = True
    reason = "Unauthorized"


class ForbiddenError(KubeError):
    """A role does not allow it. Retried: roles change, and a namespace being deleted forbids as well."""

    retriable = True
    reason = "Forbidden"


class NotFoundError(KubeError):
    """The object, its namespace or its kind is missing."""

    reason = "NotFound"


class ConflictError(KubeError):
    """Another client changed the object or owns the field, or the object is another one of the same name."""

    retriable = True
    reason = "Conflict"


class AlreadyExistsError(ConflictError):
    """The name is taken."""

    reason = "AlreadyExists"


class InvalidObjectError(KubeError):
    """The API server does not accept the object; only a changed request can succeed."""

    reason = "Invalid"


class TooManyError(KubeError):
    """The API server asks to slow down."""

    retriable = True
    reason = "TooManyRequests"


class ServerFailedError(KubeError):
    """The API server failed."""

    retriable = True
    reason = "ServerFailed"


class UnreachableError(KubeError):
    """No answer in time, or no connection."""

    retriable = True
    reason = "Unreachable"


class SilentError(UnreachableError):
    """A watch has sent nothing for too long, not even a bookmark."""


class NotLeaderError(RobotOffloadError):
    """Another operator may be writing now, so this one must not."""


def error_of(status: int, body: str, headers: Mapping[str, str], doing: str) -> KubeError:
    """Return the error for an answer of the API server.

    Args:
        status: HTTP status, 400 or more.
        body: the answer's text, normally a `Status` object in JSON.
        headers: the answer's headers; `Retry-After` is read.
        doing: the request, for the message: `apply Deployment fleet/wheelchair-agent`.
    """
    answer = _status_object(body)
    message = f"cannot {doing}: {answer.get('message') or _shortened(body) or f'HTTP {status}'}"
    causes = (answer.get("details") or {}).get("causes") or ()
    details = tuple((str(cause.get("field", "")), str(cause.get("message", ""))) for cause in causes)
    if any(field == _UID for field, _ in details):
        # For some kinds (Services) this is the answer to a write to an object that was meanwhile replaced.
        status = 409
    return _class_of(status, str(answer.get("reason", "")))(
        message, status=status, retry_after_s=_retry_after_s(headers), details=details
    )


def _class_of(status: int, reason: str) -> type[KubeError]:
    if status == 409:
        return AlreadyExistsError if reason == "AlreadyExists" else ConflictError
    known: dict[int, type[KubeError]] = {
        401: UnauthorizedError,
        403: ForbiddenError,
        404: NotFoundError,
        410: ConflictError,
        429: TooManyError,
    }
    if status in known:
        return known[status]
    return ServerFailedError if status >= 500 else InvalidObjectError


def _status_object(body: str) -> dict[str, Any]:
    try:
        value = json.loads(body)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}


def _retry_after_s(headers: Mapping[str, str]) -> float | None:
    """Return the seconds of a `Retry-After` header; a date is ignored: it would compare two hosts' clocks."""
    for name, value in headers.items():
        if name.lower() == "retry-after":
            try:
                return max(0.0, float(value))
            except ValueError:
                return None
    return None


def _shortened(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 200 else f"{line[:196]}..."
