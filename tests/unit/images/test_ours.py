"""Our own images: their Dockerfiles keep what every image promises, and they are built as they should be."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from robot_offload.images import ours, wheels_base
from robot_offload.images.ours import OURS, ROOT, Settings, request
from robot_offload.render.facts import default_images
from tests.golden.dockerfiles.test_dockerfiles import IGNORED
from tests.unit.images import parsed

SETTINGS = Settings(registry="registry.example", version="1.2.3", revision="abc")
NAMES = [image.name for image in OURS]


def text_of(name: str) -> str:
    """The Dockerfile of one of our images."""
    return (ROOT / "images" / name / "Dockerfile").read_text(encoding="utf-8")


def test_there_is_an_image_for_everything_that_a_cluster_runs_of_ours() -> None:
    images = default_images("1.2.3")
    wanted = {images.agent, images.operator, images.discovery, images.router}
    settings = Settings(registry=ours.REGISTRY, version="1.2.3", revision="abc")
    assert {request(image, settings).tag for image in OURS} == wanted


@pytest.mark.parametrize("name", NAMES)
def test_no_image_runs_as_root_or_writes_outside_of_tmp(name: str) -> None:
    instructions = parsed.instructions(text_of(name))
    last_from = max(index for index, (kind, _) in enumerate(instructions) if kind == "FROM")
    final = instructions[last_from:]
    assert [value for kind, value in final if kind == "USER"][-1] == "1000:1000"
    assert any(kind == "ENV" and 'HOME="/tmp"' in value for kind, value in final)
    assert not any(kind == "VOLUME" for kind, _ in final)


@pytest.mark.parametrize("name", NAMES)
def test_process_1_is_the_program_and_gets_sigterm(name: str) -> None:
    instructions = dict(parsed.instructions(text_of(name)))
    assert instructions["STOPSIGNAL"] == "SIGTERM"
    assert instructions["ENTRYPOINT"].startswith("["), "the exec form: a shell would keep the signal for itself"
    start = ROOT / "images" / name / "start"
    if start.exists():
        assert start.read_text(encoding="utf-8").rstrip().endswith('exec "$@"')
        assert start.stat().st_mode & 0o111


@pytest.mark.parametrize("name", NAMES)
def test_no_image_has_a_machine_id(name: str) -> None:
    final = text_of(name).rsplit("\nFROM ", 1)[1]
    assert ": > /etc/machine-id" in final


@pytest.mark.parametrize("name", NAMES)
def test_every_image_says_what_it_is(name: str) -> None:
    labels = dict(re.findall(r'org\.opencontainers\.image\.(\w+)="([^"]*)"', text_of(name)))
    assert labels["title"] == f"robot-offload-{name}"
    assert {"description", "licenses", "vendor", "version", "revision"} <= set(labels)


@pytest.mark.parametrize("name", [*NAMES, "wheels-base"])
def test_the_linter_finds_nothing(name: str) -> None:
    ignores = [word for rule in IGNORED for word in ("--ignore", rule)]
    command = [parsed.program("hadolint"), "--no-color", *ignores, str(ROOT / "images" / name / "Dockerfile")]
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("script", ["agent/start", "agent/robot-offload-agent", "discovery/start"])
def test_the_start_scripts_are_correct(script: str) -> None:
    done = subprocess.run(["bash", "-n", ROOT / "images" / script], text=True, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_agent_image_has_the_zenoh_that_we_test_with() -> None:
    (pinned,) = re.findall(r"^eclipse-zenoh==(\S+)", (ROOT / "requirements/all.txt").read_text(), re.MULTILINE)
    assert f"eclipse-zenoh=={pinned}" in text_of("agent")


def test_the_router_is_not_the_version_that_hears_no_jazzy() -> None:
    assert "ARG DDSROUTER=v3.4.0" in text_of("router")


def test_another_base_is_a_build_argument() -> None:
    wanted = request(OURS[0], SETTINGS, "base:1")
    assert wanted.tag == "registry.example/agent:1.2.3"
    assert wanted.build_arguments == {"BASE": "base:1", "VERSION": "1.2.3", "REVISION": "abc"}
    assert "BASE" not in request(OURS[0], SETTINGS).build_arguments


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs `python -m robot_offload.images.ours`."""
    command = (sys.executable, "-m", "robot_offload.images.ours", *arguments)
    return subprocess.run(command, text=True, capture_output=True, check=False, timeout=60)


def test_a_dry_run_prints_one_command_for_each_image() -> None:
    done = run("--builder", "podman", "--dry-run", "--base", "agent=mine:1")
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert [line.split("--tag ")[1].split()[0].split("/")[1].split(":")[0] for line in lines] == NAMES
    assert "--build-arg BASE=mine:1" in lines[0]


def test_without_a_registry_the_bases_are_made_of_wheels_and_the_router_is_left_out() -> None:
    lines = run("--builder", "podman", "--dry-run", "--wheels").stdout.splitlines()
    assert ["wheels-ros-core" in line for line in lines] == [True, False, True]
    assert not any("/router:" in line for line in lines)


@pytest.mark.parametrize("arguments", [("nothing",), ("--base", "agent"), ("--base", "x=y"), ("--builder", "make")])
def test_what_cannot_be_used_ends_with_2(arguments: tuple[str, ...]) -> None:
    done = run("--dry-run", *arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


def test_pins_lose_their_hashes_and_conditions() -> None:
    text = "aiohttp==3.14.0 ; sys_platform == 'linux' \\\n    --hash=sha256:00 \\\n    --hash=sha256:11\nattrs==1\n"
    assert wheels_base.constraints(text) == "aiohttp==3.14.0\nattrs==1\n"


def test_the_archives_hold_the_interpreter_and_no_caches(tmp_path: Path) -> None:
    python = tmp_path / "python"
    for name in ("bin/python3.12", "bin/pip", "lib/python3.12/os.py", "lib/python3.12/test/a.py", "lib/libx.a",
                 "lib/python3.12/site-packages/x.py", "lib/python3.12/__pycache__/os.pyc", "share/man/x"):  # fmt: skip
        (python / name).parent.mkdir(parents=True, exist_ok=True)
        (python / name).touch()
    wheels_base.pack(python, tmp_path / "python.tar", wheels_base.of_python)
    with tarfile.open(tmp_path / "python.tar") as archive:
        files = [(member.name, member.uid) for member in archive if member.isfile()]
    assert files == [("usr/local/bin/python3.12", 0), ("usr/local/lib/python3.12/os.py", 0)]
    assert wheels_base.of_system(tarfile.TarInfo("var/log/dpkg.log")) is None
    assert wheels_base.of_system(tarfile.TarInfo("etc/passwd")) is not None
