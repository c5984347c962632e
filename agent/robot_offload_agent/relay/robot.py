"""The shell of the robot's relay: the collector's memory, the journal, calls that a predecessor left open."""

from __future__ import annotations

import secrets
from collections.abc import Sequence

from robot_offload_agent.relay.inherited import SelfTest
from robot_offload_agent.relay.journal import Journal
from robot_offload_agent.relay.process import RelayShell, start
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.collector_memory import HolderView
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_agent.settings.served import private_name
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.relay.robot import RobotRelay
from robot_offload_core.words.holding import Holding

SELF_TEST = "/relay_self_test"


class RobotRelayShell(RelayShell):
    """The robot's relay in its shell."""

    def __init__(self, configuration: Configuration, bus: Bus, plan: RelayPlan) -> None:
        super().__init__(configuration, bus)
        self.view = HolderView(configuration.runtime_dir)
        self.journal = Journal(configuration.runtime_dir)
        if not self.journal.kept:
            message = "The journal cannot be allocated: goals are lost when the relay dies; make room in runtime_dir"
            self.problems["journal"] = ("JournalFull", message)
        self.self_test = SelfTest(self.node, self.loop, private_name(self.side, SELF_TEST))
        self.inherited.possible = None
        self.build(plan)
        records = self.journal.load()
        self.succeeds = bool(records)
        self.process = RobotRelay(plan, self, secrets.token_hex(16), records)

    def turn(self) -> float:
        """See RelayShell; the self test gets its turns too, until it ends."""
        due_s = super().turn()
        if not self.self_test.closed:
            due_s = min(due_s, self.self_test.turn())
            self.inherited.possible = self.self_test.passed
            if self.self_test.passed is False:
                message = (
                    "This middleware cannot answer calls that were open when the relay died: their clients must ask "
                    "again; use rmw_fastrtps_cpp on the robot"
                )
                self.problems["inherited"] = ("OpenCallsLost", message)
        return due_s

    def holder(self) -> Holding:
        """Read the holder."""
        return self.view.look()

    def keep(self, record: bytes) -> bool:
        """Append a record to the journal."""
        return self.journal.append(record)

    def compact(self, records: Sequence[bytes]) -> bool:
        """Replace the journal."""
        return self.journal.compact(records)


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, RobotRelayShell)
