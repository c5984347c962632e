"""When a request is sent again, and how long after. Pure: the client waits, this decides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robot_offload.kube.errors import KubeError, ServerFailedError, TooManyError, UnreachableError

_FIRST_PAUSE_S: Final = 0.2
_LONGEST_PAUSE_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """How patient one request is. Longer troubles are for the caller, who reads everything anew.

    Attributes:
        attempts: how often a request is sent at most.
        request_timeout_s: seconds to wait for one answer.
    """

    attempts: int = 4
    request_timeout_s: float = 15.0

    def pause_s(self, error: KubeError, attempt: int, *, idempotent: bool) -> float | None:
        """Return seconds to wait before the next attempt; None: give up.

        A request that may not be sent twice is only repeated when it was surely not carried out (429).

        Args:
            error: what came back.
            attempt: how many attempts were made.
            idempotent: whether sending it twice does no more than sending it once.
        """
        if attempt >= self.attempts:
            return None
        if not isinstance(error, TooManyError) and not (
            idempotent and isinstance(error, ServerFailedError | UnreachableError)
        ):
            return None
        if error.retry_after_s is not None:
            # Longer than our longest pause is not for us to sit out: the caller comes back later.
            return error.retry_after_s if error.retry_after_s <= _LONGEST_PAUSE_S else None
        return min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2.0 ** (attempt - 1))
