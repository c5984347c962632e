"""The shell of the robot's control process: services, override, settings of the cloud, placement and diagnostics."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robot_offload_agent.certificates.keeper import CertificateKeeper
from robot_offload_agent.control import culprits, numbers
from robot_offload_agent.control.process import ControlShell, start
from robot_offload_agent.record import audit
from robot_offload_agent.record.link_csv import Recorder
from robot_offload_agent.ros.services import SwitchServices
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s, now_us
from robot_offload_agent.runtime.release import release
from robot_offload_agent.settings import robot_report
from robot_offload_agent.settings.adopted import RobotSettings
from robot_offload_agent.settings.liaison import LEAVING_S
from robot_offload_agent.settings.override import Override
from robot_offload_agent.settings.parameters import Configuration, too_tight
from robot_offload_core.control import weight
from robot_offload_core.control.nodes import replica_parameters
from robot_offload_core.control.robot import placement, switcher
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.control.robot.process import RobotControlProcess, RobotPlan
from robot_offload_core.control.tallies import LinkTally
from robot_offload_core.fence.token import Site
from robot_offload_core.link import links, momentary
from robot_offload_core.record.audit import Kind
from robot_offload_core.words.decided import Decided
from robot_offload_core.words.messages import Arrived, CollectorStatus, Notes, Reported
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.reasons import Reason

log = logging.getLogger(__name__)

REPORT_COST = "report.cpu_us"
"""Counter in diagnostics: processor time that the report to the cloud has taken, µs."""


class RobotControlShell(ControlShell):
    """The robot's control process in its shell: takes settings and overrides, publishes placement and diagnostics."""

    process: RobotControlProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        started_us = now_us()
        self.since_s = started_us / 1e6
        self.published = ""
        self.switched: tuple[float, str, str] | None = None
        self.override = Override(configuration)
        self.tuned = RobotSettings(configuration, self.post, self.adopt)
        self.certificate = CertificateKeeper(configuration, self.post, self.send_notes)
        present = self.tuned.present
        plan = RobotPlan(
            configuration.settings(), present.settings(), present.input_specs(), configuration.node_specs(),
            bool(configuration["inhibit_service"]), self.override.wish(self.since_s), configuration.output_specs(),
            tuple(o["node"] for o in configuration.outputs), configuration["strict"],
            configuration.relay_plan() is not None, bool(configuration.states), configuration.shape(),
        )  # fmt: skip
        self.process = RobotControlProcess(plan, self, self.incarnation, started_us)
        self.report.show_settings(present)
        self.counters: dict[str, int] = {}
        self.tally = LinkTally()
        relay = configuration.relay_plan()
        self.actions = tuple(action.name for action in relay.actions) if relay is not None else ()
        self.served = tuple(service.name for service in relay.services) if relay is not None else ()
        self.watched = momentary.Watched()
        self.weight, self.weighed_due_s = weight.Weight(), 0.0
        self.processes: dict[str, list[int]] = {}
        self.services = SwitchServices(self.report.guardian, self.report.switcher_names(), self.post_switch)
        self.report.declare_override(self.override, lambda: self.post(self.set_override))
        record = configuration.values.get("record_file")  # of the command line, no parameter
        self.recorder = Recorder(Path(record), self.process.settings.beat_period_s) if record else None
        self.audit = audit.of(configuration)
        self.witnesses.append(self.audit)
        self.answered = ("", "")
        self.audited_pin, self.serial = str(present["pin"]), ""
        self.audit.say(Kind.START, "agent", release=release(), generation=str(self.tuned.generation))
        self.audit.start()
        self.effects_changed()

    # -- events in ----------------------------------------------------------------------------------------------------

    def post_switch(self, site: Site, key: int) -> None:
        """Hand a call of one of the services to the deciding thread (ROS thread)."""
        self.post(lambda _now: self.process.step(placement.SwitchByHand(site, key)))

    def set_override(self, now: float) -> None:
        """Take the override that was set (deciding thread)."""
        self.process.step(placement.SetPin(self.override.wish(now)))

    def take(self, message: Any) -> None:
        """Take one datagram; count a beat, publish what viewers draw."""
        super().take(message)
        live = self.report.live
        if isinstance(message, Arrived):
            self.tally.look(self.process.robot.link, message.arrived_s, self.process.settings.loss_timeout_s)
            if live is not None:
                live.measured(self.process.robot.link)
            if self.recorder is not None:
                self.recorder.take(self.process.robot.link)
        elif isinstance(message, CollectorStatus) and live is not None:
            charge = message.report.charge
            live.passes(None if charge is None else charge.site)

    def adopt(self, _now: float) -> None:
        """Adopt the cloud's offered settings if they were accepted, once they were answered (deciding thread)."""
        present = self.tuned.present
        self.note_settings()
        self.process.adopt(present.settings(), present.input_specs())
        self.report.note("settings", self.tuned.problem)
        self.report.show_settings(present)
        self.send_limits()
        self.send_notes()

    def note_settings(self) -> None:
        """Record in the audit trail the answer to an offer, once, and a pin that came with it."""
        judgement, pin = self.tuned.judgement, str(self.tuned.present["pin"])
        answered = (self.tuned.judged, judgement.reason.value)
        if answered == self.answered:
            return
        self.answered = answered
        who = f"resource, offered by the cloud's agent {self.process.robot.link.peer}"
        offer = self.tuned.heard.offer
        generation = str(self.tuned.generation if offer is None else offer.generation)
        author = offer.author if offer is not None and offer.digest == self.tuned.judged else ""
        self.audit.say(
            Kind.SETTINGS, who, generation=generation, digest=self.tuned.judged, answer=judgement.reason.value,
            message=judgement.message, changed_by=author,
        )  # fmt: skip
        if pin != self.audited_pin:
            self.audit.say(Kind.PIN, who, before=self.audited_pin, to=pin, generation=generation, changed_by=author)
            self.audited_pin = pin

    def note_certificate(self) -> None:
        """Record in the audit trail that the robot dials with another certificate."""
        found = self.certificate.credential
        if found.serial in ("", self.serial):
            return
        who = "authority of the cluster" if self.serial else "found at the start"
        self.audit.say(Kind.CERTIFICATE, who, serial=found.serial, before=self.serial, not_after=found.not_after)
        self.serial = found.serial

    def send_limits(self) -> None:
        """Send the other processes their limits: at changes, and repeatedly because a process may be new."""
        limits = self.tuned.limits()
        for process in ("collector", "data"):
            self.bus.send(process, limits)

    def take_notes(self, message: Notes, now: float) -> None:
        """Take notes of the cloud that the pulse receives."""
        if message.incarnation != self.process.robot.link.peer:
            return
        if self.process.announce_leaving(self.tuned.take(message.text), now + LEAVING_S):
            self.send_notes()
        heard = self.tuned.heard
        self.certificate.hear(heard.signs, heard.answer, now)
        self.comparison.hear(heard.parameters)
        self.process.veto("cloud", heard.vetoes)

    def send_notes(self) -> None:
        """Send the robot's notes to the cloud."""
        robot = self.process.robot
        decided = robot.decided
        message = self.explained(decided.reason, decided.message)
        text = self.tuned.notes(
            self.process.left[1],
            switcher.site(robot),
            decided.reason,
            message,
            self.certificate.credential,
            replica_parameters.statements(self.comparison.compared),
            str(self.audit.head),
        )
        self.bus.send("data", Notes(self.incarnation, text))

    def turned(self, now: float) -> None:
        """Write the recording; end an override that has expired."""
        if self.recorder is not None:
            self.recorder.flush(now)
        if self.override.expire():
            self.audit.say(Kind.OVERRIDE, "its time was over", to=self.override.word)
            self.report.show_override(self.override.word)

    # -- what the core's process needs --------------------------------------------------------------------------------

    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Answer a call of one of the services."""
        self.services.answer(key, accepted, message)

    def decided(self, decided: Decided) -> None:
        """Log a decision and publish the placement."""
        verdict = decided.verdict
        self.tally.decided(decided, self.process.robot.link.peer, now_s())
        if decided.switched:
            self.since_s = now_s()
            self.switched = (self.since_s, decided.site.value, verdict.reason.value)
        silent = "" if decided.silent_s is None else f" silent_ms={decided.silent_s * 1e3:.0f}"
        message = self.explained(verdict.reason, verdict.message)
        log.info(
            "%s placement=%s phase=%s epoch=%d reason=%s%s", message, decided.site.value, decided.phase.value,
            decided.epoch, verdict.reason, silent,
        )  # fmt: skip
        self.publish_placement(verdict.reason, message, decided.silent_s)
        if self.report.live is not None:
            self.report.live.note(f"{decided.site.value}, {decided.phase.value}: {message} ({verdict.reason})")

    def explained(self, reason: str, message: str) -> str:
        """Return the message of a decision with the nodes and topics that it is about."""
        process = self.process
        problems = process.data_status.problems if process.data_status else ()
        link = self.pulse_status.message if self.pulse_status else ""
        return culprits.explained(reason, message, process.guardian.nodes, process.replicas, problems, link)

    def effects_changed(self) -> None:
        """Publish the placement again."""
        decided = self.process.robot.decided
        self.publish_placement(decided.reason, self.explained(decided.reason, decided.message))

    def publish_placement(self, reason: str, message: str, silent_s: float | None = None) -> None:
        """Publish the latched /offload/placement."""
        robot, effects = self.process.robot, self.process.take_effects()
        body = {
            "site": switcher.site(robot).value,
            "phase": robot.phase.value,
            "epoch": robot.epoch,
            "reason": reason,
            "message": message,
            "since_s": round(self.since_s, 6),
            "silent_ms": None if silent_s is None else round(silent_s * 1e3, 1),
            "effects": effects.value if effects is not None else "none",
            "control": self.incarnation,
        }
        self.published = message
        self.report.publish_placement(json.dumps(body))
        if self.report.live is not None:
            self.report.live.decided(switcher.site(robot), reason)
        self.send_notes()

    def available(self, statements: tuple[Available, ...]) -> None:
        """Publish and log which nodes with placement Cloud have results that reach the robot."""
        for one in statements:
            word = one.reason.value if one.reason else "Available"
            log.info("Node %s in the cloud: %s reason=%s", one.node, one.message, word)
        self.report.publish_available(statements)

    # -- reports ------------------------------------------------------------------------------------------------------

    def publish_report(self, now: float) -> None:
        """Publish diagnostics and network status, and run the slow checks."""
        process = self.process
        self.report.publish_network_status(process.sustained())
        decided = process.robot.decided
        if self.explained(decided.reason, decided.message) != self.published:  # why is known a while after what
            self.effects_changed()
        self.report.note("replicas", process.missing_replicas())
        tight = too_tight(self.tuned.present)
        self.report.note("limits", (Problem.LIMIT_TOO_TIGHT, tight) if tight else None)
        self.report.note("settings", self.tuned.problem)
        self.report.note("certificate", self.certificate.problem)
        self.note_certificate()
        self.note_weight(now)
        self.report.note("audit", (Problem.AUDIT_FAILED, self.audit.problem) if self.audit.problem else None)
        self.compare_parameters()
        process.veto("managers", self.other_managers)
        self.send_limits()
        self.send_notes()
        undeclared = self.managed.undeclared()
        heard_twice = [it.publishes for it in undeclared.values() if it.publishes]
        process.veto("nodes", [(Reason.UNDECLARED_PUBLISHER, warning) for warning in heard_twice])
        for node, found in undeclared.items():
            publishes, serves, calls = found.publishes, found.serves, found.calls
            self.report.note(f"undeclared {node}", ("UndeclaredPublisher", publishes) if publishes else None)
            self.report.note(f"serves {node}", (Problem.UNDECLARED_SERVER, serves) if serves else None)
            self.report.note(f"calls {node}", (Problem.UNDECLARED_CALL, calls) if calls else None)
            if (publishes or serves) and self.configuration["strict"]:
                self.fail_start(publishes or serves)
        statuses = (process.data_status, process.collector_status, process.relay_status)
        for status in statuses:
            self.counters.update(dict(status.counters) if status else {})
        robot = process.robot
        self.report.publish_diagnostics(
            link=links.health(robot.link, now),
            pulse=self.pulse_status,
            placement={
                "site": switcher.site(robot).value, "phase": robot.phase.value, "epoch": str(robot.epoch),
                "reason": robot.decided.reason,
                "message": self.explained(robot.decided.reason, robot.decided.message),
                "generation": str(self.tuned.generation),
                "release": release(), "cloud_release": self.tuned.heard.release, "audit": str(self.audit.head),
            },
            nodes=process.guardian.nodes,
            counters=self.counters | self.life_counters(),
            problems=[p for status in statuses if status for p in status.problems],
        )  # fmt: skip
        begun_ns = time.thread_time_ns()
        self.send_numbers(now)
        spent_us = (time.thread_time_ns() - begun_ns) // 1000
        self.counters[REPORT_COST] = self.counters.get(REPORT_COST, 0) + spent_us

    def note_weight(self, now: float) -> None:
        """Report an agent that takes more of the robot's computer than it should."""
        self.processes = numbers.processes({name: deaths for name, deaths, _, _ in self.lives.processes})
        self.weight = weight.read(self.weight, sum(used_ms for used_ms, _, _ in self.processes.values()) / 1e3, now)
        if now >= self.weighed_due_s:
            self.weighed_due_s = now + weight.WINDOW_S
            self.report.note("weight", weight.problem(self.weight, os.cpu_count() or 1))

    def send_numbers(self, now: float) -> None:
        """Send the robot's own numbers to the cloud, which shows them beside its own."""
        process, robot, counters = self.process, self.process.robot, self.counters
        collector = process.collector_status
        self.watched = momentary.watch(self.watched, robot.link, now)
        glance = momentary.glance(self.watched, now, process.settings.beat_period_s)
        health = links.health(robot.link, now)
        inputs = [spec.name for spec in self.configuration.inputs]
        outputs = [spec.name for spec in self.configuration.outputs]
        plain = {
            "release": release(), "site": switcher.site(robot).value, "phase": robot.phase.value,
            "latency_ms": glance.latency_ms, "loss_share": glance.loss_share,
            "limit_ms": process.settings.allowed_loop_s * 1e3, "clock_offset_ms": health.clock_offset_ms,
            "ready": process.is_ready(), **numbers.of_link(self.tally),
            "changeover": numbers.changeover(self.switched, collector.silence if collector else None, now),
            "used": [counters.get(f"open.used_{word}", 0) for word in ("goals", "calls")],
        }  # fmt: skip
        lists: dict[str, Mapping[str, Any]] = {
            "gaps": numbers.gaps(counters, outputs),
            "processes": self.processes,
            "goals": numbers.goals(counters, self.actions),
            "actions": numbers.actions(counters, self.actions),
            "services": numbers.services(counters, self.served),
            "refused": numbers.refused(counters, outputs),
            "topics": numbers.topics(counters, inputs),
            "ages": dict(collector.ages_ms) if collector else {},
            "nodes": dict(process.node_states()),
            "states": {
                state.name: counters[key]
                for state in self.configuration.states
                if (key := f"state {state.name}.age_at_change_ms") in counters
            },
        }
        self.bus.send("data", Reported(robot_report.encode(self.incarnation, plain, lists)))

    def compare_parameters(self) -> None:
        """Report parameters that differ between the replicas; they keep the policy from choosing the cloud."""
        process = self.process
        resting = process.robot.preparation is None  # a side that gets ready may declare some more at any moment
        alike = [name for name, state in process.node_states() if resting and process.replicas.get(name) == state]
        found = replica_parameters.problem(replica_parameters.differences(self.comparison.compared, alike))
        self.report.note("parameters", found)
        process.veto("parameters", [found] if found else [])
        self.report.note("degraded", process.degraded())
        self.report.note("while", process.unjudged())


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, RobotControlShell)
