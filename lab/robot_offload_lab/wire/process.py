"""The process behind the emulated link: ports, control socket and log around one loop.

Control: one JSON object per datagram on a unix socket. A sender that has bound an address of its own gets
an answer: `{"ok": true, ...}` or `{"error": "..."}`.

* `{"set": {...}}` puts conditions on top of the schedule at once, see `EmulatedLink.override`;
* `{"start": true}` starts the schedule's clock at 0; the answer holds the moment as `started_s`;
* `{"status": true}` changes nothing; the answer holds ports, counters and conditions.

Log: JSON lines, each with `t_s` (steady clock of the host) and `event`: `listening`, `started`, `set`,
`changed` (an outage or a slow phase began or ended), `refused` (a control message), `realtime_refused`,
`stopped`, and every half second `counters`.
"""

from __future__ import annotations

import dataclasses
import gc
import json
import os
import signal
import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, TextIO

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.wire.link import ControlError, EmulatedLink
from robot_offload_lab.wire.loop import READ, Loop, steady_s
from robot_offload_lab.wire.model import WireError
from robot_offload_lab.wire.options import WireConfig
from robot_offload_lab.wire.tcp import TcpForward
from robot_offload_lab.wire.udp import UdpForward

TICK_S = 0.5
"""How often the counters are written and idle clients forgotten."""

REALTIME_PRIORITY = 10
"""SCHED_FIFO priority when requested: any value takes precedence over every normal process of the machine."""

_LARGEST_COMMAND = 65536


class WireProcessError(RobotOffloadError):
    """The wire's process could not start, died or does not answer."""


class WireProcess:
    """Runs the relays until SIGTERM or SIGINT. Everything happens in `run`, on one thread."""

    def __init__(self, config: WireConfig, *, parent: int | None = None) -> None:
        """Read the trace; open nothing yet.

        Args:
            config: what to do.
            parent: stop when this process is no longer the parent.

        Raises:
            WireError: the link's options cannot be understood.
        """
        self._config = config
        self._parent = parent
        self._link = EmulatedLink(config.link.schedule(), config.seed)
        self._loop = Loop()
        self._forwards: dict[str, UdpForward | TcpForward] = {}
        self._control: socket.socket | None = None
        self._log: TextIO | None = None
        self._running = True

    def run(self) -> None:
        """Relay until SIGTERM, SIGINT or the parent's end.

        Raises:
            WireProcessError: a port, the control socket or the log cannot be opened.
        """
        with ExitStack() as stack:
            stack.callback(self._loop.close)
            try:
                self._open(stack)
            except OSError as error:
                raise WireProcessError(f"the emulated link cannot start: {error}") from error
            self._stop_on_signals(stack)
            self._become_punctual()
            self._write("listening", ports=self._ports())
            if self._config.start:
                self._start()
            # Objects that exist now live as long as the process: letting the collector visit them only costs time.
            gc.collect()
            gc.freeze()
            self._tick()
            while self._running:
                self._loop.run_once()
            self._write_counters()
            self._write("stopped")

    def _open(self, stack: ExitStack) -> None:
        if self._config.log:
            log = Path(self._config.log).open("w", encoding="utf-8")  # noqa: SIM115  (the stack closes it)
            self._log = stack.enter_context(log)
        for forward in self._config.forwards:
            relay = UdpForward if forward.protocol == "udp" else TcpForward
            try:
                self._forwards[forward.name] = opened = relay(self._loop, self._link, forward)
            except OSError as error:
                raise OSError(f"{forward.protocol} port {forward.listen} ({forward.name}): {error}") from error
            stack.callback(opened.close)
        if self._config.control:
            # Last, because programs that wait for the wire wait for this socket.
            path = Path(self._config.control)
            path.unlink(missing_ok=True)
            self._control = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            self._control.setblocking(False)
            try:
                self._control.bind(str(path))
            except OSError as error:
                raise OSError(f"control socket {path}: {error}") from error
            stack.callback(path.unlink, missing_ok=True)
            self._loop.watch(self._control, READ, self._on_control)

    def _stop_on_signals(self, stack: ExitStack) -> None:
        # The handler alone would not end the wait: Python resumes an interrupted select.
        waiting, waking = socket.socketpair()
        for sock in (waiting, waking):
            stack.enter_context(sock)
            sock.setblocking(False)

        def stop(_number: int, _frame: object) -> None:
            self._running = False
            with suppress(OSError):
                waking.send(b"x")

        self._loop.watch(waiting, READ, lambda events: None)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)

    def _become_punctual(self) -> None:
        # By default the kernel may wake a normal process 50 us late to save power, which would be most of our error.
        with suppress(OSError):
            Path("/proc/self/timerslack_ns").write_text("1000", encoding="ascii")
        if self._config.realtime:
            try:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME_PRIORITY))
            except OSError as error:
                self._write("realtime_refused", message=str(error))

    def _start(self) -> None:
        self._link.start(steady_s())
        self._write("started")
        self._await_change()

    def _await_change(self) -> None:
        started_s = self._link.started_s
        change_s = self._link.next_change_s(steady_s())
        if change_s is None:
            return

        def changed() -> None:
            if self._link.started_s == started_s:  # otherwise a new start has its own chain of changes
                self._write("changed", conditions=self._conditions())
                self._await_change()

        # Looking a moment later makes clear on which side of the edge the time is.
        self._loop.call_at(change_s + 0.001, changed)

    def _tick(self) -> None:
        now_s = steady_s()
        for forward in self._forwards.values():
            forward.forget_idle(now_s)
        self._write_counters()
        if self._parent is not None and os.getppid() != self._parent:
            self._running = False
        self._loop.call_at(now_s + TICK_S, self._tick)

    def _on_control(self, _events: int) -> None:
        assert self._control is not None
        try:
            data, sender = self._control.recvfrom(_LARGEST_COMMAND)
        except OSError:
            return
        try:
            answer = {"ok": True, **self._obey(data)}
        except WireError as error:
            self._write("refused", message=str(error))
            answer = {"error": str(error)}
        if sender:
            with suppress(OSError):  # the asker may be gone
                self._control.sendto(json.dumps(answer).encode(), sender)

    def _obey(self, data: bytes) -> dict[str, Any]:
        try:
            command = json.loads(data)
        except ValueError as error:
            raise ControlError(f"a control message must be JSON: {error}") from error
        match command:
            case {"set": dict(changes)} if len(command) == 1:
                self._link.override(changes)
                self._write("set", set=changes, conditions=self._conditions())
                return {}
            case {"start": True} if len(command) == 1:
                self._start()
                return {"started_s": self._link.started_s}
            case {"status": True} if len(command) == 1:
                return {
                    "ports": self._ports(),
                    "started_s": self._link.started_s,
                    "conditions": self._conditions(),
                    **self._counters(),
                }
        raise ControlError(f'write {{"set": {{...}}}}, {{"start": true}} or {{"status": true}}, found {command!r}')

    def _ports(self) -> dict[str, int]:
        return {name: forward.port for name, forward in self._forwards.items()}

    def _conditions(self) -> dict[str, Any]:
        up, down = self._link.conditions(steady_s())
        return {"up": dataclasses.asdict(up), "down": dataclasses.asdict(down)}

    def _counters(self) -> dict[str, Any]:
        values: dict[str, Any] = {name: dataclasses.asdict(value) for name, value in self._link.counters.items()}
        values["clients"] = {name: forward.clients for name, forward in self._forwards.items()}
        return values

    def _write_counters(self) -> None:
        self._write("counters", **self._counters(), conditions=self._conditions())

    def _write(self, event: str, **values: object) -> None:
        if self._log is not None:
            self._log.write(json.dumps({"t_s": round(steady_s(), 6), "event": event, **values}) + "\n")
            self._log.flush()
