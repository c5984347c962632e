"""Settings that change while the robot runs: which apply at once, and which must wait.

Two changes are not safe while a cloud may act under an earlier grant:

* A shorter lease. Grants of the longer one are still valid, and the robot would assume too early that the cloud has
  stopped. A longer lease is safe at once: grants name their length, and the robot waits for the longer one from now on.
* `Observe`. An agent that only observes never switches, not even after a loss, so the robot must act before it begins.

All other settings only affect how the robot judges what it hears.
"""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Mode, Settings


def meanwhile(present: Settings, asked: Settings) -> Settings:
    """Return the settings that apply instead of `asked` as long as the cloud may act."""
    held = replace(asked, lease_s=max(present.lease_s, asked.lease_s))
    if asked.mode is Mode.OBSERVE and present.mode is Mode.AUTO:
        held = replace(held, mode=Mode.AUTO, pin=Site.ROBOT)
    return held
