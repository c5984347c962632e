"""Our own images: their Dockerfiles keep what every image promises, and they are built as they should be."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
from importlib import metadata
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload.images.builders import commands
from robot_offload.images.inside import pins
from robot_offload.objects.facts import default_images
from robot_offload_lab.images import ours, wheels_base
from robot_offload_lab.images.ours import OURS, ROOT, BuildSettings, request
from tests.golden.dockerfiles.test_dockerfiles import IGNORED
from tests.unit.operator.images import parsed

SETTINGS = BuildSettings(registry="registry.example", version="1.2.3", revision="abc")
NAMES = [image.name for image in OURS]
FOLDERS = list(dict.fromkeys(image.folder.name for image in OURS))


def text_of(name: str) -> str:
    """The Dockerfile of one of our images."""
    return (ROOT / "images" / name / "Dockerfile").read_text(encoding="utf-8")


def test_there_is_an_image_for_everything_that_a_cluster_runs_of_ours() -> None:
    images = default_images("1.2.3")
    wanted = {images.agent, images.operator, images.discovery, images.router, images.git}
    settings = BuildSettings(registry=ours.REGISTRY, version="1.2.3", revision="abc")
    assert {request(image, settings).tag for image in OURS if not image.example} == wanted


def test_there_is_an_image_for_every_example_and_an_agent_with_the_messages_that_an_example_has() -> None:
    folders = {path.parent for path in (ROOT / "examples").glob("*/robotoffload.yaml")}
    assert {image.example for image in OURS if image.example} == {folder.name for folder in folders}
    assert {image.example for image in OURS if image.over} == {
        folder.name for folder in folders if (folder / "interfaces").exists()
    }
    for image in (image for image in OURS if image.example):
        text = (ROOT / "manifests" / "samples" / f"{image.example}.yaml").read_text(encoding="utf-8")
        assert f"{ours.REGISTRY}/{image.name}:{metadata.version('robot-offload')}" in text


def test_an_example_with_messages_of_its_own_is_built_where_a_compiler_is_and_its_agent_is_laid_over_it() -> None:
    talker, sedia, agent = (
        next(image for image in OURS if image.name == f"examples/{name}") for name in ("talker", "sedia", "sedia-agent")
    )
    wanted = request(sedia, SETTINGS, "base:1", "compilers:1")
    assert wanted.build_arguments["EXAMPLE"] == "sedia"
    assert (wanted.build_arguments["BASE"], wanted.build_arguments["BUILD_BASE"]) == ("base:1", "compilers:1")
    assert "BUILD_BASE" not in request(talker, SETTINGS, "base:1", "compilers:1").build_arguments
    assert request(agent, SETTINGS, None, "compilers:1").build_arguments == {
        "BASE": request(sedia, SETTINGS).tag, "VERSION": "1.2.3", "REVISION": "abc",
    }  # fmt: skip
    assert agent.folder == ROOT / "images" / "agent"


@pytest.mark.parametrize("image", ["example", "example-interfaces"])
def test_what_the_nodes_of_examples_import_is_in_their_images(image: str) -> None:
    copied = [value for kind, value in parsed.instructions(text_of(image)) if kind == "COPY"]
    assert "state/robot_offload_state /opt/example/robot_offload_state" in copied
    kept = (ROOT / "images" / image / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    sources = [word for value in copied if "--from" not in value for word in value.split()[:-1]]
    assert all(any(f"!{source}".startswith(line) for line in kept if line[0] == "!") for source in sources)


@pytest.mark.parametrize("name", FOLDERS)
def test_no_image_runs_as_root_or_writes_outside_of_tmp(name: str) -> None:
    instructions = parsed.instructions(text_of(name))
    last_from = max(index for index, (kind, _) in enumerate(instructions) if kind == "FROM")
    final = instructions[last_from:]
    assert [value for kind, value in final if kind == "USER"][-1] == "1000:1000"
    assert any(kind == "ENV" and 'HOME="/tmp"' in value for kind, value in final)
    assert not any(kind == "VOLUME" for kind, _ in final)


@pytest.mark.parametrize("name", FOLDERS)
def test_process_1_is_what_the_start_script_becomes_and_gets_sigterm(name: str) -> None:
    instructions = dict(parsed.instructions(text_of(name)))
    assert instructions["STOPSIGNAL"] == "SIGTERM"
    assert instructions["ENTRYPOINT"].startswith("["), "the exec form: a shell would keep the signal for itself"
    start = ROOT / "images" / name / "start"
    if start.exists():
        assert start.read_text(encoding="utf-8").rstrip().endswith('exec "$@"')
        assert start.stat().st_mode & 0o111


@pytest.mark.parametrize("name", FOLDERS)
def test_no_image_has_a_machine_id(name: str) -> None:
    final = text_of(name).rsplit("\nFROM ", 1)[1]
    assert ": > /etc/machine-id" in final


@pytest.mark.parametrize("name", FOLDERS)
def test_every_image_says_what_it_is(name: str) -> None:
    labels = dict(re.findall(r'org\.opencontainers\.image\.(\w+)="([^"]*)"', text_of(name)))
    assert labels["title"] == f"robot-offload-{name}"
    assert {"description", "licenses", "vendor", "version", "revision"} <= set(labels)


@pytest.mark.parametrize("name", [*FOLDERS, "wheels-base"])
def test_the_linter_finds_nothing(name: str) -> None:
    ignores = [word for rule in IGNORED for word in ("--ignore", rule)]
    command = [parsed.program("hadolint"), "--no-color", *ignores, str(ROOT / "images" / name / "Dockerfile")]
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("script", ["agent/start", "agent/robot-offload-agent", "discovery/start", "discovery/serve"])
def test_the_start_scripts_are_correct(script: str) -> None:
    done = subprocess.run(["bash", "-n", ROOT / "images" / script], text=True, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


PINS = """\
aiohttp==3.14 ; sys_platform != 'win32' \\
    --hash=sha256:00 \\
    --hash=sha256:01
    # via
    #   robot-offload-workspace (pyproject.toml:operator)
    #   kopf
kopf==1.45 \\
    --hash=sha256:02
    # via robot-offload-workspace (pyproject.toml:operator)
numpy==2 \\
    --hash=sha256:03
    # via matplotlib
yarl==1.25 \\
    --hash=sha256:04
    # via aiohttp
"""


def test_an_image_gets_the_pins_of_what_it_names_and_of_what_that_needs() -> None:
    picked = pins.chosen(PINS, ["kopf"])
    assert re.findall(r"^\S+==", picked, re.MULTILINE) == ["aiohttp==", "kopf==", "yarl=="]
    assert "--hash=sha256:00" in picked
    assert pins.dependencies('[project]\ndependencies = ["robot-offload-core", "Kopf>=1", "x[y]; z"]') == ("kopf", "x")


def test_what_is_not_pinned_is_told() -> None:
    command = (sys.executable, pins.__file__, str(ROOT / "requirements/all.txt"), "no-such-package")
    done = subprocess.run(command, text=True, capture_output=True, check=False, timeout=60)
    assert (done.returncode, "does not pin 'no-such-package'" in done.stderr) == (1, True)


@pytest.mark.parametrize("name", ["agent", "operator"])
def test_packages_are_the_tested_ones_with_their_hashes(name: str) -> None:
    installs = [
        command for command in parsed.shell_commands(text_of(name)) if "pip" in command and "install" in command
    ]
    for command in installs:
        for install in re.findall(r"python3 -m pip [^;]*install [^;]*", command):
            assert "--require-hashes" in install or "--no-index" in install, install


@pytest.mark.parametrize("name", ["agent", "operator"])
def test_a_changed_line_of_ours_makes_only_the_last_layer_anew(name: str) -> None:
    text = text_of(name)
    assert text.index("FROM dependencies AS code") < text.index(f"COPY {name} ")
    final = parsed.instructions(text.rsplit("\nFROM ", 1)[1])
    layers = [value for kind, value in final if kind in ("RUN", "COPY", "ADD")]
    assert "--from=code" in layers[-1]
    assert not any("--from=code" in layer for layer in layers[:-1])


def test_the_router_is_not_the_version_that_hears_no_jazzy() -> None:
    assert "ARG DDSROUTER=v3.4.0" in text_of("router")


def test_another_base_is_a_build_argument() -> None:
    wanted = request(OURS[0], SETTINGS, "base:1")
    assert wanted.tag == "registry.example/agent:1.2.3"
    assert wanted.build_arguments == {"BASE": "base:1", "VERSION": "1.2.3", "REVISION": "abc"}
    assert "BASE" not in request(OURS[0], SETTINGS).build_arguments


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs `python -m robot_offload_lab.images.ours`."""
    command = (sys.executable, "-m", "robot_offload_lab.images.ours", *arguments)
    return subprocess.run(command, text=True, capture_output=True, check=False, timeout=60)


def test_a_dry_run_prints_one_command_for_each_image() -> None:
    done = run("--builder", "podman", "--dry-run", "--base", "agent=mine:1")
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert [line.split("--tag ")[1].split()[0].split("/", 1)[1].split(":")[0] for line in lines] == NAMES
    assert "--build-arg BASE=mine:1" in lines[0]


def test_images_are_saved_for_clusters_that_load_archives() -> None:
    lines = run("git", "examples/talker", "--builder", "buildah", "--dry-run", "--save", "out").stdout.splitlines()
    saved = [line.split()[-1] for line in lines if "docker-archive:" in line]
    version = metadata.version("robot-offload")
    assert saved == [
        f"docker-archive:out/{file}.tar:{ours.REGISTRY}/{name}:{version}"
        for file, name in (("git", "git"), ("examples-talker", "examples/talker"))
    ]


def test_without_a_registry_the_bases_are_made_of_wheels_and_the_router_is_left_out() -> None:
    lines = run("--builder", "podman", "--dry-run", "--wheels").stdout.splitlines()
    made = dict(zip([image.name for image in OURS if image.wheels_stage], lines, strict=True))
    assert {name for name, line in made.items() if "BASE=localhost/robot-offload/wheels-ros-core:" in line} == {
        "agent", "discovery", "examples/talker", "examples/wheelchair", "examples/sedia",
    }  # fmt: skip
    assert "BUILD_BASE=localhost/robot-offload/wheels-ros-compilers:" in made["examples/sedia"]
    assert "/examples/sedia:" in made["examples/sedia-agent"].split("BASE=")[1].split()[0]
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


def test_the_base_is_made_anew_when_what_it_is_made_of_changes(tmp_path: Path) -> None:
    context, archive = tmp_path / "context", tmp_path / "system.tar"
    context.mkdir()
    (context / "Dockerfile").write_text("FROM scratch\n")
    archive.write_text("system")
    first = wheels_base.fingerprint(context, [archive])
    assert wheels_base.fingerprint(context, [archive]) == first
    (context / "Dockerfile").write_text("FROM scratch\nUSER 1\n")
    second = wheels_base.fingerprint(context, [archive])
    archive.write_text("another system")
    assert len({first, second, wheels_base.fingerprint(context, [archive])}) == 3


def test_a_build_on_the_wheels_asks_for_no_user_namespace_and_borrows_certificates() -> None:
    for tool in ("buildah", "podman"):
        lent = wheels_base.lent(tool)
        assert lent[:2] == ("--isolation", "chroot")
        assert all(path.endswith(":ro") for path in lent[3:])
    assert wheels_base.lent("docker") == (), "docker knows neither option"


def test_the_systems_own_python_cannot_be_taken_along(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "base_prefix", "/usr")
    (tmp_path / "bookworm").mkdir()
    (tmp_path / "bookworm/system.tar").touch()
    with pytest.raises(InputError, match="uv python install"):
        wheels_base.archives(tmp_path)


def test_what_of_the_repository_counts_is_told_to_every_builder() -> None:
    wanted = request(OURS[0], SETTINGS)
    ignored = "--ignorefile", str(ROOT / "images/agent/Dockerfile.dockerignore")
    for tool in ("buildah", "podman"):
        (command,) = commands(tool, wanted)
        assert command[command.index("--ignorefile") :][:2] == ignored
    (command,) = commands("docker", wanted)
    assert "--ignorefile" not in command, "docker finds it beside the Dockerfile"


def test_our_images_take_their_times_from_the_same_variable_as_those_of_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert "--timestamp 1700000000" in run("agent", "--builder", "buildah", "--dry-run").stdout
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "today")
    assert run("agent", "--builder", "buildah", "--dry-run").returncode == 2
