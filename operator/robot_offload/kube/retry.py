"""When to repeat a request, and after how long. Pure: this decides, the client waits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robot_offload.kube.errors import KubeError, ServerFailedError, TooManyError, UnreachableError

_FIRST_PAUSE_S: Final = 0.2
_LONGEST_PAUSE_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """The patience of one request. Longer failures are left to the caller, who reads everything anew.

    Attributes:
        attempts: maximum number of sends.
        request_timeout_s: seconds to wait for one answer.
    """

    attempts: int = 4
    request_timeout_s: float = 15.0

    def pause_s(self, error: KubeError, attempt: int, *, idempotent: bool) -> float | None:
        """Return the seconds to wait before the next attempt; None: give up.

        A request that may not be sent twice is only repeated if it was surely not carried out (429).

        Args:
            error: the failure.
            attempt: number of attempts made.
            idempotent: whether sending it twice has the same effect as once.
        """
        if attempt >= self.attempts:
            return None
        if not isinstance(error, TooManyError) and not (
            idempotent and isinstance(error, ServerFailedError | UnreachableError)
        ):
            return None
        if error.retry_after_s is not None:
            # A wait beyond our longest pause is left to the caller, who comes back later.
            return error.retry_after_s if error.retry_after_s <= _LONGEST_PAUSE_S else None
        return min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2.0 ** (attempt - 1))
