"""The cloud's control process: the three remote_ nodes around the lease."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

from robot_offload_agent.control.process import ControlProcess, start
from robot_offload_agent.process.bus import Arrived, Bus, DataStatus, Egress, Limits, Notes, Speak
from robot_offload_agent.process.clock import now_s
from robot_offload_agent.ros.services import SwitchServices
from robot_offload_agent.settings import liaison
from robot_offload_agent.settings.cluster_files import ClusterFiles, wall_text
from robot_offload_agent.settings.notes import NotesError, decode_robot, encode
from robot_offload_agent.settings.offer import offered_limits
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core import guardians, lease, links
from robot_offload_core.beats import Beat
from robot_offload_core.events import Acting, Tick
from robot_offload_core.token import Site

log = logging.getLogger(__name__)

SILENT_S = 2.0
"""A data process that has not reported for so long is not there; it reports 25 times a second."""
REQUEST_LIFE_S = 2.0
"""How long a switch asked for here is offered to the robot before it is refused."""


class CloudControl(ControlProcess):
    """See the module."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        self.cloud = lease.Cloud(self.incarnation, self.settings)
        self.link = links.Link()
        self.liaison = liaison.Liaison(watched=bool(configuration["settings_file"]))
        self.noted: tuple[object, ...] = ()
        self.data_s = self.started_us / 1e6
        self.files = ClusterFiles(configuration, lambda event: self.post(lambda now: self.deal(event, now)))
        self.files.start()
        self.data_status: DataStatus | None = None
        self.complete = False
        self.told_sustained = 0
        self.request = ""
        self.requests = 0
        self.request_key = 0
        self.request_until_s = 0.0
        self.told: tuple[object, ...] = ()
        self.told_s = 0.0
        self.services = SwitchServices(self.report.guardian, self.report.switcher_names(), self.post_switch)

    def post_switch(self, site: Site, key: int) -> None:
        """One of the services was called: the robot decides, the request travels with our probes."""

        def ask(now: float) -> None:
            self.requests += 1
            self.request = f"{site.value}:{self.incarnation[:8]}.{self.requests}"
            self.request_until_s = now + REQUEST_LIFE_S
            self.request_key = key

        self.post(ask)

    def take_beat(self, beat: Beat, arrived: Arrived) -> None:
        """A beat of a robot."""
        self.step(lease.RobotBeat(beat, arrived.arrived_s), now_s())
        if beat.incarnation == self.cloud.robot:
            self.link = links.hear(self.link, beat, self.incarnation, arrived.arrived_s, arrived.wall_us)

    def take_message(self, message: Any) -> None:
        """The data process's view, and notes of the robot."""
        if isinstance(message, Notes):
            self.take_notes(message)
        if not isinstance(message, DataStatus) or message.cloud_data is None:
            return
        self.data_s = now_s()
        if message.counters:
            self.data_status = message
        now = now_s()
        if message.complete is not self.complete:
            self.complete = message.complete
            self.nodes_changed(now)
        request, _, answer = message.word.partition("|")
        if request and request == self.request:
            accepted, _, text = answer.partition("|")
            self.services.answer(self.request_key, accepted == "1", text)
            self.request = ""
        self.step(message.cloud_data, now)

    def tick(self, now: float) -> None:
        """Time has passed."""
        self.step(Tick(), now)
        if self.sustained(now) != self.told_sustained:
            self.told_sustained = 1 - self.told_sustained
            self.report.publish_network_status(self.told_sustained)
        if self.request and now >= self.request_until_s:
            self.services.answer(self.request_key, False, "Refused (RobotUnheard): the robot did not answer")
            self.request = ""
        connected = bool(self.cloud.robot)
        if connected is not self.liaison.connected or not self.liaison.since:
            self.deal(liaison.Seen(connected, wall_text()), now)
        self.tell_state(now)

    def take_notes(self, message: Notes) -> None:
        """What the robot served says of its settings, of who acts, and of our end."""
        if message.incarnation != self.cloud.robot:
            return
        try:
            notes = decode_robot(message.text)
        except NotesError as error:
            log.warning("Notes of the robot that are none of ours: %s", error)
            return
        self.deal(liaison.RobotSaid(notes), now_s())

    def deal(self, event: liaison.Event, now: float) -> None:
        """One event for what joins us to the operator."""
        self.liaison = liaison.step(self.liaison, event, now)
        told = (liaison.notes(self.liaison, now), liaison.taken(self.liaison))
        if told != self.noted:
            self.tell_notes(now)
        self.tell_state(now)

    def tell_notes(self, now: float) -> None:
        """Our notes for the robot, and the limits of the inputs that it has accepted."""
        notes, taken = self.noted = (liaison.notes(self.liaison, now), liaison.taken(self.liaison))
        self.bus.send("data", Notes(self.incarnation, encode(notes)))
        limits = offered_limits(self.configuration, taken)
        self.bus.send("data", Limits(self.settings.max_command_age_s, self.settings.lease_s, limits))

    def tell_state(self, now: float) -> None:
        """The state file."""
        if self.files.writer is None:
            return
        state = liaison.state(
            self.liaison,
            generation=self.configuration["generation"],
            epoch=self.cloud.epoch,
            nodes=self.node_states(),
            ready=self.pulse_status is not None and now - self.data_s < SILENT_S,
        )
        self.files.tell(state, now, lambda: liaison.figures(self.health(now)))

    def health(self, now: float) -> links.Health | None:
        """Of the link to the robot served; None when there is none."""
        return links.health(self.link, now) if self.cloud.robot else None

    def nodes_changed(self, now: float) -> None:
        """Ready means: the CORE nodes are Active and the latched inputs are the robot's."""
        self.step(lease.CloudNodes(guardians.is_ready(self.guardian) and self.complete), now)

    def step(self, event: lease.Event, now: float) -> None:
        """Steps the lease and carries out its commands."""
        self.cloud, commands = lease.step(self.cloud, event, now)
        report = next(c.report for c in commands if isinstance(c, lease.SetReport))
        egress = next(c for c in commands if isinstance(c, lease.SetEgress))
        # Ages change with every step and are worth telling once a beat; everything else at once.
        level = (replace(report, data_age_us=0, input_ages_us=()), egress, self.request)
        if level != self.told or now - self.told_s >= self.settings.beat_period_s:
            self.told, self.told_s = level, now
            self.bus.send("pulse", Speak(self.incarnation, report, now))
            words = (self.incarnation, self.cloud.robot, egress, self.node_states(), self.request)
            self.bus.send("data", Egress(*words))
        for command in commands:
            if isinstance(command, Acting) and command.acting is not self.guardian.acting:
                self.step_guardian(Acting(command.acting), now)
            elif isinstance(command, lease.StandChanged):
                log.info("%s reason=%s", command.message, command.reason)

    def sustained(self, now: float) -> int:
        """1 while a robot is heard."""
        return int(bool(self.cloud.robot) and now - self.cloud.robot_s <= self.settings.loss_timeout_s)

    def publish_report(self, now: float) -> None:
        """Diagnostics and network status."""
        self.report.publish_network_status(self.sustained(now))
        self.tell_notes(now)
        reason, message = lease.situation(self.cloud, now)
        self.report.publish_diagnostics(
            link=self.health(now),
            pulse=self.pulse_status,
            placement={
                "epoch": str(self.cloud.epoch), "robot": self.cloud.robot[:8], "reason": reason, "message": message,
            },
            nodes=self.guardian.nodes,
            counters=dict(self.data_status.counters) if self.data_status else {},
            problems=list(self.data_status.problems) if self.data_status else [],
        )  # fmt: skip


def run(configuration: Configuration) -> None:
    """Entry of the process."""
    start(configuration, CloudControl)
