"""The shell of the cloud's relay."""

from __future__ import annotations

import secrets

from robot_offload_agent.relay.process import RelayShell, start
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.relay.cloud import CloudRelay
from robot_offload_core.relay.process import RelayPlan


class CloudRelayShell(RelayShell):
    """See the module."""

    def __init__(self, configuration: Configuration, bus: Bus, plan: RelayPlan) -> None:
        super().__init__(configuration, bus)
        self.build(plan)
        self.process = CloudRelay(plan, self, secrets.token_hex(16))


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, CloudRelayShell)
