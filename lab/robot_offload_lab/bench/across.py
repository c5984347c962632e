"""A measured system whose sides are two hosts: network namespaces, so that TCP and UDP are the kernel's own."""

from __future__ import annotations

import dataclasses
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.run.processes import Program
from robot_offload_lab.run.system import System
from robot_offload_lab.wire.emulated import EmulatedWire
from robot_offload_lab.wire.two_hosts import CLOUD_ADDRESS, TwoHosts

BBR: Final = "net.ipv4.tcp_congestion_control=bbr"


class AcrossHosts(MeasuredSystem):
    """Runs the robot's and the cloud's programs in their own network namespaces. Needs root.

    Attributes:
        bears_loss: whether the robot's TCP uses BBR, which this kernel may lack.
    """

    bears_loss = False

    def _make_wire(self) -> EmulatedWire:
        return TwoHosts(self.case.link, self.setting.seed)

    def _system(self, temporary: Path) -> System:
        system = super()._system(temporary)
        return dataclasses.replace(system, dialled=system.served, cloud_host=CLOUD_ADDRESS)

    def _observers(self) -> Sequence[Program]:
        return (*super()._observers(), self._input_recorder())

    def _prepare(self) -> None:
        done = subprocess.run([*self._enter("robot"), "sysctl", "-q", "-w", BBR], capture_output=True, check=False)
        self.bears_loss = done.returncode == 0

    def _placed(self, program: Program) -> Program:
        cloud = program.environment["ROS_DOMAIN_ID"] == str(self.system.domains[1])
        return dataclasses.replace(program, command=(*self._enter("cloud" if cloud else "robot"), *program.command))

    def _enter(self, host: str) -> tuple[str, ...]:
        assert isinstance(self.wire, TwoHosts)
        return self.wire.enter(host)
