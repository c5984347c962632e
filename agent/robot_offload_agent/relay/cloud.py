"""The shell of the cloud's relay."""

from __future__ import annotations

import secrets
from functools import partial

from robot_offload_agent.relay.members import Members
from robot_offload_agent.relay.process import RelayShell, start
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.relay.cloud import CloudRelay
from robot_offload_core.relay.process import RelayPlan


class CloudRelayShell(RelayShell):
    """The cloud's relay in its shell. `members`: the pods of pools."""

    process: CloudRelay

    def __init__(self, configuration: Configuration, bus: Bus, plan: RelayPlan) -> None:
        super().__init__(configuration, bus)
        self.build(plan)
        self.members = Members(self, plan.services, configuration.runtime_dir)
        self.process = CloudRelay(plan, self, secrets.token_hex(16))

    def look(self) -> bool:
        """See RelayShell; the pods of pools come and go."""
        settled = self.members.look(self.process.pools)
        return super().look() and settled

    def call_member(self, service: str, member: str, key: int, payload: bytes) -> None:
        """Call a service at one pod of a pool."""
        self.tried(service, partial(self.members.clients[service, member].call, key, payload))

    def forget_call(self, key: int) -> None:
        """Drop a call."""
        super().forget_call(key)
        for client in self.members.clients.values():
            client.forget(key)


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, CloudRelayShell)
