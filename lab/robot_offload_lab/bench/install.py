"""Time from a clean root to a running agent, for each way to install.

    python -m robot_offload_lab.bench.install [WAY ...] [--docs]

Each way begins with an empty folder and what its user has: a Python with ROS 2 for pip, colcon and Ubuntu's setuptools
for a workspace, an image with ROS 2 for the container. It ends when the robot's agent says who acts. Packages come from
the package index as for a user, so the figures hold the network's time too.
"""

from __future__ import annotations

import argparse
import datetime
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Final

from robot_offload.images.builders import choose
from robot_offload_lab.bench import machine
from robot_offload_lab.images import wheels_base

ROOT: Final = Path(__file__).parents[3]
EXAMPLE: Final = ROOT / "examples" / "talker" / "robotoffload.yaml"
ACTS: Final = "reason=NeverHeard"
"""What a robot's agent says that has no cloud: it runs, and its own side acts."""
START_S: Final = 60.0
PAGE: Final = ROOT / "docs" / "how-to" / "robot.md"
BEGIN: Final = "<!-- install times: written by `make bench-install`; changes between these lines are lost -->\n"
END: Final = "<!-- end of the install times -->\n"
COLCON: Final = ("colcon-core", "colcon-ros", "colcon-package-selection", "colcon-bash")
DOMAIN: Final = 79
_LEFT_OUT: Final = shutil.ignore_patterns("*.egg-info", "build", "__pycache__")
_NOT_OF_ROS: Final = ("__editable__", "robot_offload", "zenoh", "eclipse_zenoh", "pip", "setuptools", "_distutils")


class InstallError(Exception):
    """A way to install did not end with a running agent."""


@dataclass(frozen=True)
class Times:
    """How long one way took.

    Attributes:
        install_s: until the programs were there.
        start_s: from their start until the agent said who acts; None: ROS 2 for that Python is not here, so the agent
            has only said its version.
    """

    install_s: float
    start_s: float | None


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures the ways that are asked for; prints a table; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.install", description=__doc__)
    parser.add_argument("ways", nargs="*", metavar="WAY", help=f"of {', '.join(WAYS)}; default: all")
    parser.add_argument("--docs", action="store_true", help="write the figures into docs/how-to/robot.md")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.ways) - set(WAYS))
    if unknown:
        parser.error(f"{unknown[0]!r} is no way to install; these are {', '.join(WAYS)}")
    found, busy = {}, machine.load()
    for way in options.ways or WAYS:
        with tempfile.TemporaryDirectory(prefix="robot-offload-install-") as folder:
            found[way] = WAYS[way](Path(folder))
        print(f"{way}: {found[way]}", file=sys.stderr, flush=True)  # noqa: T201 - a program for people
    date = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    text = table(found, date, f"{machine.words(machine.describe())}; load average {busy:.0f} at the start")
    print(text)  # noqa: T201
    if options.docs:
        page = PAGE.read_text(encoding="utf-8")
        head, _, rest = page.partition(BEGIN)
        _, _, tail = rest.partition(END)
        PAGE.write_text(f"{head}{BEGIN}\n{text}\n{END}{tail}", encoding="utf-8")
    return 0


def table(found: Mapping[str, Times], date: str, words: str) -> str:
    """Returns the figures as a piece of a page."""
    rows = [
        f"| {way} | {it.install_s:.1f} | {_cell(it.start_s)} | {_cell(it.start_s and it.install_s + it.start_s)} |\n"
        for way, it in found.items()
    ]
    head = "| | installed after (s) | acts after its start (s) | together (s) |\n|---|---|---|---|\n"
    return f"Measured {date} by `make bench-install`, once each: {words}.\n\n{head}{''.join(rows)}"


def _cell(value: float | None) -> str:
    return "\N{EN DASH}" if value is None else f"{value:.1f}"


def _pip(folder: Path) -> Times:
    """An environment that sees the robot's rclpy, and the two wheels of `make dist` with their constraints."""
    dist = folder / "dist"
    _run([sys.executable, "-m", "scripts.dist", "--output", str(dist)], cwd=ROOT)
    began_s = time.monotonic()
    _environment(folder / "venv")
    wheels = [str(next(dist.glob(f"robot_offload_{name}-*.whl"))) for name in ("core", "agent")]
    constraints = ["--constraint", str(dist / "constraints.txt")]
    _run([str(folder / "venv/bin/pip"), "install", "--quiet", "--no-cache-dir", *constraints, *wheels])
    installed_s = time.monotonic() - began_s
    return Times(installed_s, _acts([str(folder / "venv/bin/robot-offload-agent")], folder, with_ros(folder)))


def _colcon(setuptools: str, python: str, folder: Path) -> Times:
    """A workspace with core and agent in `src`; colcon and Ubuntu's setuptools are there already.

    Args:
        setuptools: its version in the Ubuntu of a distribution.
        python: the interpreter of that Ubuntu; rclpy is here for this process's own only.
        folder: the clean root.
    """
    own = python == f"python3.{sys.version_info.minor}"
    _environment(folder / "venv", sys.executable if own else _interpreter(python))
    tools = [*COLCON, f"setuptools=={setuptools}", "wheel", "pyyaml"]  # PyYAML comes with ROS 2
    _run([str(folder / "venv/bin/pip"), "install", "--quiet", "--no-cache-dir", *tools])
    source = folder / "src"
    source.mkdir()
    for package in ("core", "agent"):
        shutil.copytree(ROOT / package, source / f"robot_offload_{package}", ignore=_LEFT_OUT)
    ros = with_ros(folder) if own else dict(os.environ)
    environment = {**ros, "PATH": f"{folder / 'venv/bin'}:{os.environ['PATH']}"}
    began_s = time.monotonic()
    build = ["--log-base", "log", "build", "--packages-up-to", "robot_offload_agent"]
    _run([str(folder / "venv/bin/colcon"), *build], cwd=folder, env=environment)
    _run([str(folder / "venv/bin/pip"), "install", "--quiet", "--no-cache-dir", "eclipse-zenoh>=1.10,<2"])
    installed_s = time.monotonic() - began_s
    words = ["bash", "-c", f'source {folder}/install/setup.bash && exec robot-offload-agent "$@"', "-"]
    if own:
        return Times(installed_s, _acts(words, folder, environment))
    _run([*words, "--version"], env=environment)
    return Times(installed_s, None)


def _interpreter(python: str) -> str:
    """Returns a Python of another version, found on the path or with pyenv.

    Raises:
        InstallError: it is not here.
    """
    roots = sorted((Path.home() / ".pyenv" / "versions").glob(f"{python.removeprefix('python')}.*/bin/{python}"))
    found = str(roots[-1]) if roots else shutil.which(python)
    if found is None:
        raise InstallError(f"{python} is not here; install it, or leave its way out")
    return found


def _container(folder: Path) -> Times:
    """A user's image with ROS 2 as the base; none of our layers is cached."""
    tool = choose("buildah")
    wheels_base.build(tool, ROOT, wheels_base.lent(tool), ("ros-core",))
    began_s = time.monotonic()
    _run([
        sys.executable, "-m", "robot_offload_lab.images.ours", "agent", "--wheels", "--builder", "buildah",
        "--registry", "localhost/bench", "--builder-argument=--no-cache",
    ])  # fmt: skip
    installed_s = time.monotonic() - began_s
    tag = f"localhost/bench/agent:{version('robot-offload')}"
    container = _run(["buildah", "from", tag]).strip()
    mount = ["--volume", f"{folder}:{folder}"]
    try:
        words = ["buildah", "run", "--isolation", "chroot", "--user", "0", *mount, container, "--"]
        program = [*words, "/opt/robot_offload/start", "robot-offload-agent"]
        return Times(installed_s, _acts(program, folder, dict(os.environ)))
    finally:
        _run(["buildah", "rm", container])
        _run(["buildah", "rmi", tag])


WAYS: Final[Mapping[str, Callable[[Path], Times]]] = {
    "pip": _pip,
    "colcon-59.6.0": partial(_colcon, "59.6.0", "python3.10"),
    "colcon-68.1.2": partial(_colcon, "68.1.2", "python3.12"),
    "colcon-79.0.1": partial(_colcon, "79.0.1", "python3.12"),
    "container": _container,
}
"""With colcon: the version of setuptools that comes with Ubuntu for Humble, Jazzy, Lyrical."""


def with_ros(folder: Path) -> dict[str, str]:
    """Returns the variables of a shell that has sourced ROS 2: here its packages are wheels of this environment.

    Args:
        folder: where they are linked, without what this project installs itself.
    """
    packages = Path(sysconfig.get_path("purelib"))
    linked = folder / "ros"
    linked.mkdir(exist_ok=True)
    for path in packages.iterdir():
        if path.suffix != ".pth" and not path.name.startswith(_NOT_OF_ROS):
            (linked / path.name).symlink_to(path)
    return {**os.environ, "PYTHONPATH": str(linked), "ROS_DISTRO": "jazzy", "ROS_DOMAIN_ID": str(DOMAIN)}


def _environment(folder: Path, python: str = sys.executable) -> None:
    _run([python, "-m", "venv", str(folder)])


def _acts(program: Sequence[str], folder: Path, environment: Mapping[str, str]) -> float:
    """Starts a robot's agent with a bundle that names a cloud that is not there; returns the seconds until it acts."""
    bundle = folder / "bundle"
    _run([
        sys.executable, "-m", "robot_offload", "pair", str(EXAMPLE), "--host", "127.0.0.1", "-o", str(bundle),
        "--robot-folder", str(bundle / "robot"),
    ])  # fmt: skip
    file = bundle / "robot" / "agent.yaml"
    text = file.read_text(encoding="utf-8").replace("domain_id: 43", f"domain_id: {DOMAIN}")
    for place in ("/run/robot-offload", "/var/lib/robot-offload"):
        text = text.replace(place, str(folder / "state"))
    file.write_text(text, encoding="utf-8")
    began_s = time.monotonic()
    words = [*program, "robot", "--params", str(file)]
    said: list[str] = []
    with subprocess.Popen(
        words, env=dict(environment), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as agent:
        assert agent.stdout is not None
        try:
            for line in agent.stdout:
                said.append(line)
                if ACTS in line:
                    return time.monotonic() - began_s
                if time.monotonic() - began_s > START_S:
                    break
        finally:
            agent.terminate()
    raise InstallError(f"{words[0]} did not act within {START_S:g} s: {''.join(said)[-2000:]}")


def _run(words: Sequence[str], cwd: Path | None = None, env: Mapping[str, str] | None = None) -> str:
    variables = None if env is None else dict(env)
    done = subprocess.run(words, cwd=cwd, env=variables, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise InstallError(f"{' '.join(words)[:200]}: {(done.stderr or done.stdout).strip()[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    raise SystemExit(main())
