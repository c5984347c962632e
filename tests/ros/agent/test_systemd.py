"""The unit of a bundle under a systemd of its own: ready, not root, watched, restarted when it hangs, ended in order.

systemd runs as process 1 of its own namespaces (processes, mounts, network, cgroups), so that the host's is left alone.
The bundle is mounted where its README puts it. What differs from a robot: no D-Bus, and a watchdog of 4 s instead of
15 s, by a drop-in. Needs root and systemd 250 or newer.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ros.agent.ears import wait_until
from tests.ros.agent.shared import Shared

ROOT = Path(__file__).parents[3]
UNIT = "robot-offload-agent.service"
PATIENCE_S = 60.0
CAP_SYS_NICE = 23
"""Its number in linux/capability.h."""
INIT = """
mount --make-rprivate /
mount --make-rshared /
if [ -e /sys/fs/cgroup/cgroup.controllers ]; then mount -t cgroup2 none /sys/fs/cgroup; fi
ip link set lo up
mount -t tmpfs tmpfs /run
mount -t tmpfs tmpfs /var/lib
mkdir -p /var/lib/robot-offload/wheelchair
touch /var/lib/robot-offload/wheelchair/of-root
mkdir /run/interpreter
mount --bind {interpreter} /run/interpreter
for closed in {closed}; do mount -t tmpfs -o mode=755 tmpfs $closed; done
mkdir -p {interpreter}
mount --bind /run/interpreter {interpreter}
mkdir -p /run/systemd/system/{unit}.d /run/systemd/system/only.target.wants /run/etc /run/etc.work
mount -t overlay overlay -o lowerdir=/etc,upperdir=/run/etc,workdir=/run/etc.work /etc
mkdir -p /etc/robot-offload/wheelchair
cp -r {folder}/pair/robot/. /etc/robot-offload/wheelchair
cp {folder}/pair/robot/{unit} /run/systemd/system
cp {folder}/setup.bash /etc/robot-offload/setup.bash
echo ROBOT_OFFLOAD_SETUP=/etc/robot-offload/setup.bash >> /etc/robot-offload/wheelchair/environment
printf '[Service]\\nWatchdogSec=4\\n' > /run/systemd/system/{unit}.d/test.conf
printf '[Unit]\\nDefaultDependencies=no\\nAllowIsolate=yes\\n' > /run/systemd/system/only.target
printf '[Unit]\\nDefaultDependencies=no\\n' > /run/systemd/system/{unit}.d/alone.conf
ln -s ../{unit} /run/systemd/system/only.target.wants/
exec env -i PATH=/usr/bin:/bin:/usr/sbin:/sbin container=other /lib/systemd/systemd --system --unit=only.target \\
    --log-target=console --show-status=no --default-standard-output=inherit
"""
"""Process 1 of the namespaces. Mounts are shared among them, as systemd makes them at the start of a machine."""
NAMESPACES = ("--pid", "--fork", "--mount", "--mount-proc", "--net", "--cgroup", "--uts", "--ipc", "--kill-child")


class Manager:
    """A systemd in namespaces of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log_path = folder / "systemd.log"
        script = folder / "init.sh"
        interpreter = Path(sys.base_prefix)
        closed = [path for path in interpreter.parents if not path.stat().st_mode & stat.S_IXOTH]
        words = " ".join(map(str, closed[-1:]))
        script.write_text(INIT.format(unit=UNIT, folder=folder, interpreter=interpreter, closed=words))
        with self.log_path.open("wb") as log:
            self.process = subprocess.Popen(
                ["unshare", *NAMESPACES, "/bin/bash", "-e", str(script)], stdout=log, stderr=log,
                stdin=subprocess.DEVNULL,
            )  # fmt: skip

    def log(self) -> str:
        """What systemd and its services have said."""
        return self.log_path.read_text(errors="replace")

    def inside(self, command: str) -> str:
        """Runs a command in the namespaces; returns what it says, "" while there is no process 1 yet."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        if not children:
            return ""
        enter = ["nsenter", f"--target={children[0]}", "--mount", "--pid", "--net"]
        done = subprocess.run([*enter, *shlex.split(command)], capture_output=True, text=True, check=False, timeout=60)
        return done.stdout + done.stderr

    def show(self, name: str) -> str:
        """Returns a property of the unit."""
        return self.inside(f"systemctl show --property={name} --value {UNIT}").strip()

    def processes(self) -> set[int]:
        """Returns the unit's processes, as the namespaces number them."""
        listed = self.inside(f"systemctl status --no-pager --lines=0 --full {UNIT}")
        return {int(pid) for pid in re.findall(r"[├└]─\s*(\d+) ", listed)}

    def close(self) -> None:
        """Ends everything: what is in the namespace of process 1 ends with it."""
        self.process.kill()
        self.process.wait()


@pytest.fixture
def manager() -> Iterator[Manager]:
    """Runs the unit of a robot that was paired with a workstation which is not there."""
    Shared.close_present()
    with tempfile.TemporaryDirectory(prefix="ro-systemd-", dir="/var/tmp") as name:
        folder = Path(name)
        tool = Path(sys.executable).with_name("robot-offload")
        spec = ROOT / "examples/wheelchair/robotoffload.yaml"
        command = [str(tool), "pair", str(spec), "--host", "127.0.0.1", "-o", str(folder / "pair")]
        subprocess.run(command, check=True, capture_output=True)
        kept = {
            key: os.environ[key] for key in ("LD_LIBRARY_PATH", "PYTHONPATH", "AMENT_PREFIX_PATH") if key in os.environ
        }
        lines = [f"export {key}={shlex.quote(value)}" for key, value in kept.items()]
        lines += [f"export PATH={shlex.quote(str(tool.parent))}:$PATH", "export PYTHONPYCACHEPREFIX=/tmp/pycache"]
        (folder / "setup.bash").write_text("\n".join(lines) + "\n")
        started = Manager(folder)
        try:
            yield started
        finally:
            started.close()


def test_systemd_starts_watches_restarts_and_ends_the_unit_of_a_bundle(manager: Manager) -> None:
    def until(condition: object, what: str) -> None:
        assert callable(condition)
        assert wait_until(condition, PATIENCE_S), f"not seen: {what}\n{manager.log()}"

    until(lambda: manager.show("ActiveState") == "active", "the agent says that it is ready")
    assert manager.inside(f"systemd-analyze verify /run/systemd/system/{UNIT}") == ""
    until(lambda: len(manager.processes()) >= 6, "supervisor and processes run")
    first, main = manager.processes(), int(manager.show("MainPID"))
    assert main in first
    assert_not_root(manager, main)

    restarts = int(manager.show("NRestarts"))
    manager.inside(f"kill -{signal.SIGSTOP.value} {main}")
    until(lambda: int(manager.show("NRestarts")) > restarts, "the watchdog ends an agent that hangs")
    until(lambda: manager.show("ActiveState") == "active" and len(manager.processes()) >= 6, "a new agent is ready")
    assert not manager.processes() & first

    manager.inside(f"systemctl stop {UNIT}")
    assert (manager.show("ActiveState"), manager.show("Result"), manager.processes()) == ("inactive", "success", set())


def assert_not_root(manager: Manager, main: int) -> None:
    """The agent is nobody on the machine, and has what it needs: its key, its state, CAP_SYS_NICE."""
    status = dict(line.split(":", 1) for line in manager.inside(f"cat /proc/{main}/status").splitlines())
    (user,) = set(status["Uid"].split())
    (group,) = set(status["Gid"].split())
    assert int(user) >= 1000
    assert (status["NoNewPrivs"].strip(), status["Seccomp"].strip()) == ("1", "2")
    assert int(status["CapEff"], 16) == 1 << CAP_SYS_NICE
    in_unit = f"nsenter --target={main} --mount --setuid={user} --setgid={group}"
    key = "/etc/robot-offload/wheelchair/certificates/robot.key"
    assert "PRIVATE KEY" in manager.inside(f"{in_unit} cat {key}")
    assert "Permission denied" in manager.inside(f"setpriv --reuid={user} --regid={group} --clear-groups cat {key}")
    assert "Permission denied" in manager.inside(f"{in_unit} cat /etc/shadow")
    assert "Permission denied" in manager.inside(f"{in_unit} touch /etc/robot-offload/wheelchair/agent.yaml")
    assert "current" in manager.inside(f"{in_unit} ls /var/lib/robot-offload/wheelchair/certificates")
    kept = manager.inside(f"{in_unit} stat --format %u /var/lib/robot-offload/wheelchair/of-root")
    assert kept.strip() == user, "what an agent has kept as root passes to the new user"
