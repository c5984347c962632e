"""What a policy is: it receives echoes, is asked for a side at every moment, and never sees the future."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from robot_offload_core.fence.token import Site
from robot_offload_core.words.reasons import Verdict
from robot_offload_core.words.settings import Settings


@dataclass(frozen=True)
class Decision:
    """A side, with the reason and message of a user's own policy for results.json."""

    site: Site
    reason: str = ""
    message: str = ""


class SwitchingPolicy(Protocol):
    """Decides where to act. Times are seconds from the beginning of the recording.

    Whenever echoes arrive, and at each heartbeat period, `heard` is called for every new echo in order, and then
    `place` once. Earlier decisions are final: the side changes at once and never fails. The robot acts first.
    """

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Take the echo of the heartbeat sent at `sent_s`, back at `arrived_s`; the difference is the loop latency."""
        ...

    def place(self, now_s: float) -> Decision | Verdict | Site | str:
        """Return the side that acts from now on: `Site`, "robot", "cloud", or a Decision with the reason as well."""
        ...


PolicyMaker = Callable[[Settings], SwitchingPolicy]
"""Makes a fresh policy for one recording; `settings.allowed_loop_s` is the loop latency that is good enough."""
