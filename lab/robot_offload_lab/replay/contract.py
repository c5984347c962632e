"""What a policy is: it hears echoes, is asked for a side at every moment, and never sees the future."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from robot_offload_core.fence.token import Site
from robot_offload_core.words.reasons import Verdict
from robot_offload_core.words.settings import Settings


@dataclass(frozen=True)
class Decision:
    """A side with the reason and message of a policy of anybody's own, both for results.json."""

    site: Site
    reason: str = ""
    message: str = ""


class SwitchingPolicy(Protocol):
    """Decides where to act. Times are seconds from the beginning of the recording.

    At each moment at which echoes arrive, and at each beat period, `heard` is called for every echo that has arrived
    since, in order, and then `place` once. What was decided before stays decided: the side changes at once and without
    failing. The robot acts first.
    """

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Take the echo of the heartbeat sent at `sent_s`, back at `arrived_s`; the difference is the loop latency."""
        ...

    def place(self, now_s: float) -> Decision | Verdict | Site | str:
        """Return the side to act from now on: `Site`, "robot", "cloud", or a Decision with the reason as well."""
        ...


PolicyMaker = Callable[[Settings], SwitchingPolicy]
"""Makes a fresh policy for one recording; `settings.allowed_loop_s` is the loop latency that is good enough."""
