"""The shell of the cloud's control process: its connection to the operator, services and diagnostics."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

from robot_offload_agent.control import numbers
from robot_offload_agent.control.process import ControlShell, start
from robot_offload_agent.ros.services import SwitchServices
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.runtime.release import release
from robot_offload_agent.settings import liaison, robot_report
from robot_offload_agent.settings.cluster_files import ClusterFiles, wall_text
from robot_offload_agent.settings.notes import MAX_VETOES, NotesError, decode_robot, encode
from robot_offload_agent.settings.offer import offered_limits
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.control.cloud import lease
from robot_offload_core.control.cloud.lease import Stand
from robot_offload_core.control.cloud.process import CloudControlProcess
from robot_offload_core.control.nodes import replica_parameters
from robot_offload_core.control.tallies import LinkTally
from robot_offload_core.fence.token import Site
from robot_offload_core.link import momentary
from robot_offload_core.words.messages import Arrived, Limits, Notes, Reported
from robot_offload_core.words.reasons import Reason

log = logging.getLogger(__name__)

SILENT_S = 2.0
"""A data process that has not reported for this long counts as absent; it reports 25 times a second."""


class CloudControlShell(ControlShell):
    """The cloud's control process in its shell: serves switches, exchanges notes and files, publishes diagnostics."""

    process: CloudControlProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        settings = configuration.settings()
        has_relay = configuration.relay_plan() is not None
        self.process = CloudControlProcess(
            settings, configuration.node_specs(), self, self.incarnation, has_relay, configuration.output_specs(),
            tuple(o["node"] for o in configuration.outputs), bool(configuration.states),
            shape=configuration.shape(),
        )  # fmt: skip
        self.liaison = liaison.Liaison(
            watched=bool(configuration["settings_file"]), signs=bool(configuration["certificate_file"])
        )
        self.noted: tuple[object, ...] = ()
        self.watched = momentary.Watched()
        self.tally = LinkTally()
        self.numbers: dict[str, Any] = {}
        self.numbers_s = float("-inf")
        self.garbage = 0
        self.cost: dict[str, list[int]] = {}
        self.processes_due_s = 0.0
        self.topics = {spec.name: spec["topic"] for spec in (*configuration.inputs, *configuration.outputs)}
        self.files = ClusterFiles(configuration, lambda event: self.post(lambda now: self.deal(event, now)))
        self.files.start()
        self.services = SwitchServices(self.report.guardian, self.report.switcher_names(), self.post_switch)

    def post_switch(self, site: Site, key: int) -> None:
        """Hand a call of one of the services to the deciding thread (ROS thread)."""
        self.post(lambda _now: self.process.ask(site, key))

    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Answer a call of one of the services."""
        self.services.answer(key, accepted, message)

    def decided(self, reason: Stand, message: str) -> None:
        """Log a decision."""
        log.info("%s reason=%s", message, reason)

    def turned(self, now: float) -> None:
        """Report to the operator's files what has changed."""
        connected = bool(self.process.cloud.robot)
        if connected is not self.liaison.connected or not self.liaison.since:
            self.deal(liaison.Seen(connected, wall_text()), now)
        self.write_state(now)

    def take_notes(self, message: Notes, now: float) -> None:
        """Take the notes of the robot that is served: its settings, who acts, and whether it has left this cloud."""
        if message.incarnation != self.process.cloud.robot:
            return
        try:
            notes = decode_robot(message.text)
        except NotesError as error:
            log.warning("Ignoring foreign notes of the robot: %s", error)
            return
        self.comparison.hear(notes.parameters)
        self.deal(liaison.RobotSaid(notes), now)

    def take(self, message: Any) -> None:
        """Take one datagram; a beat is counted."""
        if isinstance(message, Reported):
            self.take_report(message.text, now_s())
            return
        super().take(message)
        if isinstance(message, Arrived):
            self.tally.look(self.process.link, message.arrived_s, self.process.settings.loss_timeout_s)

    def take_report(self, text: str, now: float) -> None:
        """Take the robot's own numbers; count invalid ones, and report a later version as a problem."""
        try:
            self.numbers = robot_report.decode(text, self.process.cloud.robot, self.topics)
        except robot_report.StrangerError:
            return
        except robot_report.ReportError as error:
            self.garbage += 1
            other = error.reason == "OtherVersion"
            self.report.note("report", ("OtherVersion", str(error)) if other else None)
            return
        self.numbers_s = now
        self.report.note("report", None)

    def deal(self, event: liaison.Event, now: float) -> None:
        """Process one event for the exchange with the operator."""
        self.liaison = liaison.step(self.liaison, event, now)
        told = (liaison.notes(self.liaison, now), liaison.taken(self.liaison))
        if told != self.noted:
            self.send_notes(now)
        self.write_state(now)

    def send_notes(self, now: float) -> None:
        """Send the cloud's notes for the robot, and the limits of the inputs that the robot has accepted."""
        notes, taken = self.noted = (liaison.notes(self.liaison, now), liaison.taken(self.liaison))
        stated = replica_parameters.statements(self.comparison.compared)
        vetoes = (*self.other_managers, *self._second_session(), *self._twins())[:MAX_VETOES]
        text = encode(replace(notes, vetoes=vetoes, parameters=stated, release=release()))
        self.bus.send("data", Notes(self.incarnation, text))
        settings = self.process.settings
        limits = offered_limits(self.configuration, taken)
        self.bus.send("data", Limits(settings.max_command_age_s, settings.lease_s, limits))

    def _twins(self) -> tuple[tuple[str, str], ...]:
        """Return the problems of outputs that several processes here produce."""
        status = self.process.data_status
        return tuple(p for p in (status.problems if status is not None else ()) if p[0] == Reason.TWO_REPLICAS)

    def _second_session(self) -> tuple[tuple[str, str], ...]:
        """Return the veto while another session shows the robot's certificate: its messages may be a stranger's."""
        status = self.pulse_status
        found = status is not None and status.cause == Reason.SECOND_SESSION
        return ((Reason.SECOND_SESSION.value, status.message),) if status is not None and found else ()

    def write_state(self, now: float) -> None:
        """Write the state file."""
        if self.files.writer is None:
            return
        state = liaison.state(
            self.liaison,
            generation=self.configuration["generation"],
            epoch=self.process.cloud.epoch,
            nodes=self.process.node_states(),
            ready=self.pulse_status is not None and now - self.process.data_s < SILENT_S,
        )
        self.files.tell(state, now, lambda: self.figures(now))

    def figures(self, now: float) -> dict[str, object]:
        """Return the part of the state file that is new at each writing."""
        self.watched = momentary.watch(self.watched, self.process.link, now)
        glance = momentary.Glance()
        if self.liaison.connected:
            glance = momentary.glance(self.watched, now, self.process.settings.beat_period_s)
        fresh = self.liaison.connected and now - self.numbers_s < robot_report.FRESH_S
        return {
            **liaison.figures(self.process.health(), glance, self.carried(), self.state_ages_ms()),
            "cloud": {
                **numbers.of_link(self.tally),
                "garbage_reports": self.garbage,
                "ready": self.process.is_ready(),
                "processes": self.processes(now),
            },
            "robot": self.numbers if fresh else None,
        }

    def processes(self, now: float) -> dict[str, list[int]]:
        """Return processor time, memory and deaths of this agent's processes, read once a second."""
        if now >= self.processes_due_s:
            self.processes_due_s = now + 1.0
            self.cost = numbers.processes({name: deaths for name, deaths, _, _ in self.lives.processes})
        return self.cost

    def carried(self) -> list[liaison.Carried]:
        """Return what crossed the link so far, by topic, as this side received or sent it."""
        status = self.process.data_status
        counters = dict(status.counters) if status is not None else {}
        ways = (
            ("to_cloud", self.configuration.inputs, "published"),
            ("to_robot", self.configuration.outputs, "sent"),
        )
        return [
            liaison.Carried(
                spec["topic"],
                way,
                counters[f"{spec.name}.bytes"],
                counters.get(f"{spec.name}.{word}", 0),
                counters.get(f"{spec.name}.age_ms"),
            )
            for way, specs, word in ways
            for spec in specs
            if counters.get(f"{spec.name}.bytes")
        ]

    def state_ages_ms(self) -> dict[str, int]:
        """Return how old the state was when the cloud last began to act, by name of the entry."""
        status = self.process.data_status
        counters = dict(status.counters) if status is not None else {}
        names = [state.name for state in self.configuration.states]
        ages = {name: counters.get(f"state {name}.age_at_change_ms") for name in names}
        return {name: age_ms for name, age_ms in ages.items() if age_ms is not None}

    def publish_report(self, now: float) -> None:
        """Publish diagnostics and network status."""
        process = self.process
        self.report.publish_network_status(process.sustained())
        self.report.note("degraded", process.degraded())
        self.report.note("while", process.unjudged())
        differ = replica_parameters.differences(self.comparison.compared, ())
        self.report.note("parameters", replica_parameters.problem(differ))
        self.send_notes(now)
        reason, message = lease.situation(process.cloud, now)
        statuses = [status for status in (process.data_status, process.relay_status) if status is not None]
        self.report.publish_diagnostics(
            link=process.health(),
            pulse=self.pulse_status,
            placement={
                "epoch": str(process.cloud.epoch), "robot": process.cloud.robot[:8], "reason": reason,
                "message": message,
            },
            nodes=process.guardian.nodes,
            counters=dict(pair for status in statuses for pair in status.counters) | self.life_counters(),
            problems=[problem for status in statuses for problem in status.problems],
        )  # fmt: skip


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, CloudControlShell)
