"""The program, how it starts and how it ends."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import BuildSpec


class Entrypoint(Feature[BuildSpec]):
    """Sources the installation and the overlay, then becomes the program; tini is process 1 and passes signals on.

    `ros2 run` would swallow the signal that ends a container, so its program is started directly. `ros2 launch` ends
    its nodes in order at SIGINT only (launch's `launch_service.py`); at SIGTERM it leaves them behind. It passes the
    signal on to its nodes itself, so tini must not.
    """

    name = "entrypoint"
    stages = ("runtime",)
    flags = (
        Flag("--executable", "executable", "What the image runs, as `ros2 run PACKAGE EXECUTABLE`."),
        Flag("--launch", "launch", "What the image runs, as `ros2 launch PACKAGE FILE`.", metavar="FILE"),
        Flag("--argument", "arguments", "Argument of the program; may be repeated.", "texts"),
    )

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Check that there is one thing to run; autostart supports one node."""
        if (spec.executable is None) == (spec.launch is None):
            found = "none" if spec.executable is None else "both"
            yield Finding("executable", "Required", f"needs either executable or launch, found {found}")
        if spec.launch and spec.autostart:
            message = "a launch file starts several nodes; let it take them to Active itself and leave autostart out"
            yield Finding("autostart", "NotSupported", message)

    def packages(self, spec: BuildSpec, stage: Stage) -> tuple[str, ...]:
        """Return the package of process 1."""
        return ("tini",) if stage == "runtime" else ()

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the script, the signal and the command."""
        if spec.launch:
            command = ("ros2", "launch", "--noninteractive", spec.package, spec.launch, *spec.arguments)
        else:
            command = ("ros2", "run", spec.package, str(spec.executable), *spec.arguments)
        tini = ("/usr/bin/tini",) if spec.launch else ("/usr/bin/tini", "-g")
        return {
            "command": command,
            "stop_signal": "SIGINT" if spec.launch else spec.release.stop_signal,
            "entrypoint": (*tini, "--", "/usr/local/bin/robot-offload-node"),
        }
