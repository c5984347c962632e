"""The pulse process: beats out every period, beats in at once, nothing else.

It has its own session and its own process so that beats wait for no data, garbage collection or ROS discovery.

Beats go out by an alarm on the main thread. On the robot they also go out on the link's thread, with a beat of the
cloud that has just arrived: then the alarm is postponed, and the main thread sleeps on.
"""

from __future__ import annotations

import gc
import logging
import threading
from collections import Counter

from robot_offload_agent.link.choice import LinkHandle, open_link
from robot_offload_agent.link.port import Channel, LinkStatus
from robot_offload_agent.runtime import realtime
from robot_offload_agent.runtime.alarm import Alarm
from robot_offload_agent.runtime.beacon import Beacon
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s, wall_us
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.runtime.heard_memory import HeardMemory
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.pulse import pulse
from robot_offload_core.words import beats
from robot_offload_core.words.messages import Arrived, Heard, PulseSent, PulseStatus, Reopen, Speak

log = logging.getLogger(__name__)

BEAT = Channel("beat", reliable=False, urgent=True)
STATUS_PERIOD_S = 1.0
LONGEST_S = 0.5
"""The main thread wakes up this often although beats go out without it: it shows that it lives."""
SESSION_LOOK_S = 0.1
"""Interval of the looks at the session's state, which people read."""


class PulseProcess:
    """Connects the core's pulse, the link and the bus."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.lock = threading.Lock()  # of the pulse's state
        self.speaking = threading.Lock()  # one beat after the other goes out
        self.alarm = Alarm()
        period_s = configuration["heartbeat_period_ms"] / 1e3
        self.pulse = pulse.Pulse(configuration["uid"], configuration.side, period_s)
        self.garbage: Counter[str] = Counter()
        self.status = LinkStatus(False)
        self.status_due_s = self.look_due_s = 0.0
        self.realtime = "normal"
        self.sent: PulseSent | None = None
        self.told_sent_s = 0.0
        self.link: LinkHandle | None = None
        self.heard: HeardMemory | None = None
        try:
            self.heard = HeardMemory(bus.folder)
        except OSError as error:
            log.warning("No memory file for the newest beat: %s; data is woken for each one", error)
        self.beacon = Beacon(bus, "main")
        self.guard = Guard()

    def run(self) -> None:
        """Run until it is ended."""
        gc.disable()  # nothing here makes cycles; a collection would hold up beats
        self.link = open_link(self.configuration, "pulse", [BEAT], self.on_message)
        self.link.start()
        self.realtime = realtime.request(self.configuration["realtime"], realtime.PULSE_PRIORITY)
        while not self.link.ended():
            self.beacon.sign("main")
            with self.speaking:
                now, wake_s = now_s(), pulse.wake_s(self.pulse)
                if now >= wake_s:
                    self.send(now)
                else:
                    self.alarm.set(wake_s)
            self.alarm.wait(LONGEST_S)

    def send(self, now: float) -> None:
        """Send one beat, with control's newest order; call with `speaking` held."""
        assert self.link is not None
        self.read()  # only now: each waking up costs
        with self.lock:
            self.pulse, beat = pulse.compose(self.pulse, now, wall_us())
            wake_s = pulse.wake_s(self.pulse)
        self.link.send("beat", b"", beats.encode_fitting(beat).encode())
        self.alarm.set(wake_s)
        self.sent = PulseSent(now, isinstance(beat.body, beats.Permission) and beat.body.granted)
        # `Arrived` carries it; it is sent separately only while no beats arrive.
        if now - self.told_sent_s > self.pulse.beat_period_s:
            self.told_sent_s = now
            self.bus.send("control", self.sent)
        if now < self.look_due_s:
            return
        self.look_due_s = now + SESSION_LOOK_S
        status = self.link.status()
        if status != self.status or now >= self.status_due_s:
            self.status, self.status_due_s = status, now + STATUS_PERIOD_S
            ours = {"pulse": self.bus.garbage + self.guard.count}
            garbage = tuple(sorted({**self.garbage, **ours, **dict(status.counters)}.items()))
            told = (status.connected, status.endpoint, status.fallback, status.sessions, status.message)
            self.bus.send("control", PulseStatus(*told, garbage, self.realtime, status.cause.value))

    def read(self) -> None:
        """Take control's messages."""
        while (message := self.bus.receive()) is not None:
            with self.guard:
                self.handle(message)

    def handle(self, message: object) -> None:
        """Take one message of control."""
        if isinstance(message, Speak):
            with self.lock:
                self.pulse = pulse.speak(self.pulse, message.incarnation, message.body, message.said_s)
        elif isinstance(message, Reopen) and self.link is not None:
            self.link.reopen(message.reason)

    def on_message(self, _channel: str, _header: bytes, payload: bytes) -> None:
        """Take a beat that arrived (on a thread of the link)."""
        arrived_s = now_s()
        if not payload:
            self.garbage["BareBeat"] += 1  # feeds statistics only: it proves no round trip and renews nothing
            return
        try:
            text = payload.decode("ascii")
            beat = beats.decode(text)
        except (UnicodeDecodeError, beats.BeatError) as error:
            reason = error.reason if isinstance(error, beats.BeatError) else "BadForm"
            self.garbage[reason] += 1
            if self.garbage[reason] == 1:
                log.warning("A beat that is none of ours arrived (%s), further ones are only counted", error)
            return
        with self.lock:
            self.pulse, newer = pulse.hear(self.pulse, beat, arrived_s)
            partner = pulse.partner(self.pulse)
        if beat.uid != self.configuration["uid"]:
            self.garbage["ForeignUid"] += 1
        if newer:
            self.told_sent_s = arrived_s
            self.answer(arrived_s)
            self.bus.send("control", Arrived(text, arrived_s, wall_us(), self.sent))
            if partner is not None:
                self.pass_on(Heard(partner.incarnation, partner.sent_us, partner.arrived_s))

    def answer(self, arrived_s: float) -> None:
        """Send the next beat with the one that has just arrived, if that spares the main thread a wake-up."""
        with self.speaking:
            if self.link is not None and pulse.joins(self.pulse, arrived_s):
                self.send(arrived_s)

    def pass_on(self, heard: Heard) -> None:
        """Pass data the newest beat: in memory, or as a datagram if there is none."""
        if self.heard is None:
            self.bus.send("data", heard)
        else:
            self.heard.write(heard)


def run(configuration: Configuration) -> None:
    """Run the process."""
    PulseProcess(configuration, Bus(configuration.runtime_dir, "pulse")).run()
