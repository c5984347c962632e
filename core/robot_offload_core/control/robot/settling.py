"""Settings that change while the robot runs: what may hold at once, and what must wait.

Two changes are not safe while a cloud may act under what was granted before:

* A shorter lease. Grants of the longer one are still out, and the robot would take the cloud for stopped too early. A
  longer lease is safe at once: grants name their length, and the robot waits for the longer one from now on.
* `Observe`. An agent that only observes never switches, not even after a loss, so the robot must act before it begins.

Everything else is the robot's own judgement of what it hears.
"""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Mode, Settings


def meanwhile(present: Settings, asked: Settings) -> Settings:
    """Return what holds instead of `asked` as long as the cloud may act."""
    held = replace(asked, lease_s=max(present.lease_s, asked.lease_s))
    if asked.mode is Mode.OBSERVE and present.mode is Mode.AUTO:
        held = replace(held, mode=Mode.AUTO, pin=Site.ROBOT)
    return held
