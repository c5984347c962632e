"""The robot's control process: network_monitor, cloud_switcher and guardian around the placement machine."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

from robot_offload_agent.control.process import ControlProcess, start
from robot_offload_agent.control.recorder import Recorder
from robot_offload_agent.process.bus import Arrived, Bus, CollectorStatus, DataStatus, Notes, Orders, Speak
from robot_offload_agent.process.clock import now_s
from robot_offload_agent.ros.services import SwitchServices
from robot_offload_agent.settings.adopted import RobotSettings
from robot_offload_agent.settings.liaison import LEAVING_S
from robot_offload_agent.settings.override import Override
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core import guardians, health, links, placement, switcher
from robot_offload_core.beats import Beat
from robot_offload_core.events import Acting, Tick
from robot_offload_core.settling import meanwhile
from robot_offload_core.token import Site

log = logging.getLogger(__name__)

LEVELS_PER_LEASE = 5
UNSEEN = guardians.State.UNKNOWN.value
REPLICA_GRACE_S = 3.0
"""How long a replica may be on its way before it is reported missing."""

DEADLINE_MARGIN_S = 0.0005
"""Behind a deadline, so that one tick finds it passed."""


class RobotControl(ControlProcess):
    """See the module."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        started_s = self.started_us / 1e6
        self.override = Override(configuration)
        self.tuned = RobotSettings(configuration, self.post, self.adopt)
        asked = self.tuned.present.settings()
        # Until the cloud has stopped for sure the longest lease that an earlier process may have granted counts.
        self.robot = placement.Robot(
            self.incarnation, self.started_us, meanwhile(self.settings, asked), self.tuned.present.input_specs(),
            since_s=started_s, charged_s=started_s, pin=self.override.wish(started_s), asked=asked,
        )  # fmt: skip
        self.settings = asked
        self.guardian = replace(self.guardian, grace_s=asked.activation_deadline_s)
        self.report.show_settings(self.tuned.present)
        self.data_status: DataStatus | None = None
        self.collector_status: CollectorStatus | None = None
        self.levels: dict[str, tuple[placement.SetGate | Orders, float]] = {}
        self.replicas: dict[str, str] = {}
        self.complete_s = started_s
        self.told_sustained = 0
        self.counters: dict[str, int] = {}
        self.since_s = started_s
        self.effects: Site | None = None
        self.asked_in_cloud = ""
        self.left = ("", "")  # (cloud, its last words before its end), as far as obeyed
        self.services = SwitchServices(self.report.guardian, self.report.switcher_names(), self.post_switch)
        self.report.declare_override(self.override, lambda: self.post(self.set_override))
        record = configuration.values.get("record_file")  # of the command line, no parameter
        self.recorder = Recorder(Path(record), self.settings.beat_period_s) if record else None
        self.publish_placement(self.robot.decided.reason, self.robot.decided.message)

    # -- events in ----------------------------------------------------------------------------------------------------

    def post_switch(self, site: Site, key: int) -> None:
        """One of the services was called (ROS thread)."""
        self.post(lambda now: self.step(placement.SwitchByHand(site, key), now))

    def set_override(self, now: float) -> None:
        """The override was set (deciding thread)."""
        self.step(placement.SetPin(self.override.wish(now)), now)

    def take_beat(self, beat: Beat, arrived: Arrived) -> None:
        """A beat of the cloud."""
        self.step(placement.CloudBeat(beat, arrived.arrived_s, arrived.wall_us), now_s())
        if self.recorder is not None:
            self.recorder.take(self.robot.link)

    def take_message(self, message: Any) -> None:
        """Reports of pulse, collector and data."""
        now = now_s()
        if isinstance(message, placement.PulseSent):
            self.step(message, now)
        elif isinstance(message, CollectorStatus):
            if message.counters:
                self.collector_status = message
            self.step(placement.GateReported(message.report), now)
        elif isinstance(message, DataStatus) and message.report is not None:
            if message.counters or message.replicas:
                self.data_status = message
            if message.replicas:
                self.replicas = dict(message.replicas)
            self.step(message.report, now)
            self.ask_for_cloud(message, now)
        elif isinstance(message, Notes):
            self.take_notes(message, now)

    def adopt(self, now: float) -> None:
        """Settings that the cloud offers were answered, and are in force when they were taken (deciding thread)."""
        self.settings = self.tuned.present.settings()
        self.guardian = replace(self.guardian, grace_s=self.settings.activation_deadline_s)
        self.step(placement.SetSettings(self.settings, self.tuned.present.input_specs()), now)
        self.report.note("settings", self.tuned.problem)
        self.report.show_settings(self.tuned.present)
        self.tell_limits()
        self.tell_notes()

    def tell_limits(self) -> None:
        """Limits that the other processes keep: at changes, and again because they may be new."""
        limits = self.tuned.limits()
        for process in ("collector", "data"):
            self.bus.send(process, limits)

    def take_notes(self, message: Notes, now: float) -> None:
        """Notes of the cloud that the pulse hears."""
        cloud = self.robot.link.peer
        if message.incarnation != cloud:
            return
        leaving = self.tuned.take(message.text)
        if leaving and (cloud, leaving) != self.left:
            self.left = cloud, leaving
            self.step(placement.CloudLeaving(cloud, now + LEAVING_S), now)
            self.tell_notes()

    def tell_notes(self) -> None:
        """Our notes for the cloud."""
        decided = self.robot.decided
        text = self.tuned.notes(self.left[1], switcher.site(self.robot), decided.reason, decided.message)
        self.bus.send("data", Notes(self.incarnation, text))

    def ask_for_cloud(self, message: DataStatus, now: float) -> None:
        """A switch by hand asked for in the cloud; each request once."""
        if message.word and message.word != self.asked_in_cloud:
            self.asked_in_cloud = message.word
            site, _, _ = message.word.partition(":")
            self.step(placement.SwitchByHand(Site(site), SwitchServices.FROM_CLOUD), now)

    def tick(self, now: float) -> None:
        """Time has passed."""
        self.step(Tick(), now)
        if self.recorder is not None:
            self.recorder.flush(now)
        if self.sustained(now) != self.told_sustained:
            self.told_sustained = 1 - self.told_sustained
            self.report.publish_network_status(self.told_sustained)
        if self.override.expire():
            self.report.show_override(self.override.word)
        if switcher.effects_site(self.robot, now) is not self.effects:
            self.publish_placement(self.robot.decided.reason, self.robot.decided.message)

    def next_deadline_s(self) -> float:
        """The loss of the cloud is noticed to the millisecond, not at the next tick."""
        good_s = self.robot.situation.good_s
        if switcher.site(self.robot) is Site.ROBOT or good_s is None:
            return float("inf")
        return good_s + self.settings.loss_timeout_s + DEADLINE_MARGIN_S

    def nodes_changed(self, now: float) -> None:
        """Readiness of the robot's nodes changed."""
        self.step(placement.NodesReported(guardians.is_ready(self.guardian)), now)

    # -- commands out -------------------------------------------------------------------------------------------------

    def step(self, event: placement.Event, now: float) -> None:
        """Steps the machine and carries out its commands."""
        self.robot, commands = switcher.step(self.robot, event, now)
        for command in commands:
            self.carry_out(command, now)

    def carry_out(self, command: placement.Command, now: float) -> None:
        """One command."""
        if isinstance(command, placement.SetGate):
            self.renew("collector", command, now)
        elif isinstance(command, placement.Permit):
            self.bus.send("pulse", Speak(self.incarnation, command.permission, now))
            self.renew("data", Orders(self.incarnation, self.robot.epoch, self.answered_cloud()), now)
        elif isinstance(command, Acting):
            known = (self.guardian.acting, self.guardian.outputs_flow, self.guardian.in_charge)
            if known != (command.acting, command.outputs_flow, command.acting and command.in_charge):
                acting = Acting(command.acting, command.outputs_flow, command.in_charge)
                self.step_guardian(acting, now)
        elif isinstance(command, placement.Reopen):
            for process in ("pulse", "data"):
                self.bus.send(process, command)
        elif isinstance(command, placement.Answer):
            self.services.answer(command.key, command.accepted, command.message)
        elif isinstance(command, placement.Decided):
            self.told(command, now)

    def renew(self, process: str, message: placement.SetGate | Orders, now: float) -> None:
        """Sends a level at once when it changed, else five times in a lease: the others live with an older one."""
        told, told_s = self.levels.get(process, (None, 0.0))
        if message != told or now - told_s >= self.settings.lease_s / LEVELS_PER_LEASE:
            self.levels[process] = message, now
            self.bus.send(process, message)

    def answered_cloud(self) -> str:
        """The answer to the last request from the cloud, a level in our probes."""
        return f"{self.asked_in_cloud}|{self.services.cloud_answer}" if self.asked_in_cloud else ""

    def told(self, decided: placement.Decided, now: float) -> None:
        """A decision: log line and placement."""
        verdict = decided.verdict
        if decided.switched:
            self.since_s = now
        silent = "" if decided.silent_s is None else f" silent_ms={decided.silent_s * 1e3:.0f}"
        log.info(
            "%s placement=%s phase=%s epoch=%d reason=%s%s", verdict.message, decided.site.value, decided.phase.value,
            decided.epoch, verdict.reason, silent,
        )  # fmt: skip
        self.publish_placement(verdict.reason, verdict.message, decided.silent_s)

    def publish_placement(self, reason: str, message: str, silent_s: float | None = None) -> None:
        """The latched /offload/placement."""
        effects = self.effects = switcher.effects_site(self.robot, now_s())
        body = {
            "site": switcher.site(self.robot).value,
            "phase": self.robot.phase.value,
            "epoch": self.robot.epoch,
            "reason": reason,
            "message": message,
            "since_s": round(self.since_s, 6),
            "silent_ms": None if silent_s is None else round(silent_s * 1e3, 1),
            "effects": effects.value if effects is not None else "none",
            "control": self.incarnation,
        }
        self.report.publish_placement(json.dumps(body))
        self.tell_notes()

    # -- reports ------------------------------------------------------------------------------------------------------

    def sustained(self, now: float) -> int:
        """1 while the link sustains the cloud."""
        heard_s = self.robot.link.heard_s
        alive = heard_s is not None and now - heard_s <= self.settings.loss_timeout_s
        return int(alive and health.fitness(self.robot.link, self.settings, now).ok)

    def missing_replicas(self, now: float) -> tuple[str, str] | None:
        """Duplicated nodes that the cloud, while it is connected, has not seen for a while."""
        report = self.data_status.report if self.data_status else None
        unseen = [
            n.spec.name for n in self.guardian.nodes
            if n.spec.duplicated and self.replicas.get(n.spec.name, UNSEEN) == UNSEEN
        ]  # fmt: skip
        if not unseen or report is None or not report.connected or not self.replicas:
            self.complete_s = now
        if now - self.complete_s < REPLICA_GRACE_S:
            return None
        return "ReplicaMissing", f"No replica in the cloud of: {', '.join(unseen)}"

    def publish_report(self, now: float) -> None:
        """Diagnostics, network status, slow checks."""
        self.report.publish_network_status(self.sustained(now))
        self.report.note("replicas", self.missing_replicas(now))
        self.report.note("settings", self.tuned.problem)
        self.tell_limits()
        self.tell_notes()
        for node, warning in self.managed.undeclared().items():
            self.report.note(f"undeclared {node}", ("UndeclaredPublisher", warning) if warning else None)
            if warning and self.configuration["strict"]:
                self.fail_start(warning)
        for data in (self.data_status, self.collector_status):
            self.counters.update(dict(data.counters) if data else {})
        problems = [p for s in (self.data_status, self.collector_status) if s for p in s.problems]
        self.report.publish_diagnostics(
            link=links.health(self.robot.link, now),
            pulse=self.pulse_status,
            placement={
                "site": switcher.site(self.robot).value, "phase": self.robot.phase.value,
                "epoch": str(self.robot.epoch), "reason": self.robot.decided.reason,
                "message": self.robot.decided.message, "generation": str(self.tuned.generation),
            },
            nodes=self.guardian.nodes,
            counters=self.counters,
            problems=problems,
        )  # fmt: skip


def run(configuration: Configuration) -> None:
    """Entry of the process."""
    start(configuration, RobotControl)
