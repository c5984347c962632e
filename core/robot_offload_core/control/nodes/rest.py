"""When the nodes of a side that no longer acts may be deactivated: after their goals and requests have ended.

A deactivated server aborts its goals and no longer answers, so the relay must finish first (handover, rule 3). A side
that was called off for its goals or state while it got ready stays Active for `settleFor`, to collect what it lacked (a
costmap, a pose).
"""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.words.messages import RelayStatus

RELAY_GONE_S = 0.5
"""After this long without a report a relay no longer delays the deactivation of nodes. Longer than RELAY_UNHEARD_S,
because deactivating a node too soon costs a goal."""
RELAY_LATE_S = 0.1
"""How much later than control a relay may learn of a change, and the reverse."""


class Rest:
    """Whether the nodes of a side stay Active after it has stopped acting.

    Attributes:
        site: this side.
        deadline_s: longest time that nodes are kept Active (`cancelDeadline`).
        status, status_s: newest status of the relay, and its arrival; None before the first.
        acted_s: when this side was last seen acting.
        settles_until_s: the side was called off, and stays Active until then.
    """

    def __init__(self, site: Site, deadline_s: float) -> None:
        self.site = site
        self.deadline_s = deadline_s
        self.status: RelayStatus | None = None
        self.status_s = 0.0
        self.acted_s = self.settles_until_s = float("-inf")

    def settle(self, until_s: float) -> None:
        """Keep the nodes of this side Active until `until_s`, although the side was called off."""
        self.settles_until_s = until_s

    def take(self, status: RelayStatus, now_s: float) -> None:
        """Take a status of the relay."""
        self.status, self.status_s = status, now_s

    def keeps_active(self, acting: bool, now_s: float) -> bool:
        """Return whether the nodes stay Active although the side no longer acts."""
        if acting:
            self.acted_s, self.settles_until_s = now_s, float("-inf")
            return False
        if now_s < self.settles_until_s:
            return True
        status = self.status
        if status is None or now_s - self.status_s > RELAY_GONE_S or now_s >= self.acted_s + self.deadline_s:
            return False
        unheard = status.holder is self.site and now_s < self.acted_s + RELAY_LATE_S
        return status.busy or (unheard and bool(status.executing))
