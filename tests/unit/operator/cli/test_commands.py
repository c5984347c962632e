"""The commands that need no cluster, and how all of them behave, as somebody at a terminal meets them."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
import yaml
from typer.testing import CliRunner, Result

from robot_offload.api.crd import crd
from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL
from robot_offload.cli.lazy import LazyCommand
from robot_offload.cli.main import Program, app
from robot_offload.cli.pin import end, told
from robot_offload.insight.observed import observe
from tests.unit.operator.cli.resources import manifest

SAMPLES = Path(__file__).parents[4] / "manifests" / "samples"
PROGRAMS = Path(__file__).parents[4] / ".venv" / "bin"
COMMANDS = (
    "validate", "render", "crd", "status", "explain", "bundle", "pin", "revoke", "doctor", "completion", "demo",
    "simulate", "blackbox", "audit", "bench", "dockerfile", "build",
)  # fmt: skip


def run(*arguments: str, stdin: str | None = None) -> Result:
    return CliRunner().invoke(app, list(arguments), input=stdin)


@pytest.fixture
def no_cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("KUBECONFIG", str(tmp_path / "none"))
    monkeypatch.delenv("KUBERNETES_SERVICE_HOST", raising=False)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_teaches_with_examples(command: str) -> None:
    shown = run(command, "--help")
    assert shown.exit_code == 0
    assert "Examples:\n" in shown.stdout


def test_the_first_page_names_every_command_and_hides_the_operator() -> None:
    page = run("--help").stdout
    assert all(f"\n  {command} " in page for command in COMMANDS)
    assert "\n  operator " not in page
    assert run("operator", "--help").exit_code == 0


def test_the_first_page_shows_the_first_sentence_of_each_command() -> None:
    context = typer.Context(typer.main.get_command(app))
    for entry in Program.entries:
        command = LazyCommand(entry).load()
        assert (entry.help, entry.hidden) == (command.get_short_help_str(200), command.hidden)
        assert command.name == entry.name
    assert [entry.name for entry in Program.entries] == Program(name="x").list_commands(context)


@pytest.mark.parametrize("words", [("--help",), ("--version",), ("completion", "bash"), ("validate", "--help")])
def test_a_command_imports_no_other_ones_libraries(words: tuple[str, ...]) -> None:
    foreign = ("kubernetes", "aiohttp", "jinja2", "cryptography", "robot_offload_lab")
    code = (
        "import sys; from typer.testing import CliRunner; from robot_offload.cli.main import app\n"
        f"assert CliRunner().invoke(app, {list(words)!r}).exit_code == 0\n"
        f"print([name for name in {foreign!r} if name in sys.modules])\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout == "[]\n"


def test_the_version_is_the_packages() -> None:
    assert run("--version").stdout == f"robot-offload {importlib.metadata.version('robot-offload')}\n"


def test_a_mistyped_command_is_refused_with_the_one_that_was_meant() -> None:
    done = run("vaildate", "x.yaml")
    assert done.exit_code == 2
    assert "Did you mean 'validate'" in done.stderr


def test_the_definition_is_the_generated_one() -> None:
    assert yaml.safe_load(run("crd").stdout) == yaml.safe_load(yaml.safe_dump(crd()))


def rendered(*arguments: str) -> list[dict[str, object]]:
    done = run("render", *arguments)
    assert done.exit_code == 0, done.stderr
    return list(yaml.safe_load_all(done.stdout))


def test_all_objects_are_rendered_without_a_cluster() -> None:
    objects = rendered(str(SAMPLES / "wheelchair.yaml"), "-n", "ward")
    kinds = [str(each["kind"]) for each in objects]
    assert {"Deployment", "Service", "ConfigMap", "Lease", "NetworkPolicy", "Role"} <= set(kinds)
    assert "Secret" not in kinds
    metadata = [each["metadata"] for each in objects]
    assert {part["namespace"] for part in metadata} == {"ward"}  # type: ignore[index]
    assert not [part for part in metadata if "ownerReferences" in part]  # type: ignore[operator]


def test_nodes_sleep_and_wake_as_asked() -> None:
    def replicas(*options: str) -> dict[str, int]:
        objects = rendered(str(SAMPLES / "cold.yaml"), *options)
        return {
            each["metadata"]["name"]: each["spec"]["replicas"]  # type: ignore[index]
            for each in objects
            if each["kind"] == "Deployment"
        }

    [cold] = [name for name in replicas() if not name.endswith("-agent")]
    assert replicas()[cold] == 0
    assert replicas("--robot-connected")[cold] == 1
    assert replicas("--asleep")["cold-agent"] == 1
    assert run("render", str(SAMPLES / "cold.yaml"), "--asleep", "--robot-connected").exit_code == 2


def test_standard_input_is_a_file_like_any_other() -> None:
    text = (SAMPLES / "talker.yaml").read_text()
    from_input = run("render", "-", stdin=text)
    assert from_input.stdout == run("render", str(SAMPLES / "talker.yaml")).stdout
    assert "standard input: talker is valid" in run("validate", "-", stdin=text).stdout
    assert "standard input" in run("validate", "-", stdin="{").stderr


def test_render_refuses_what_a_cluster_would_refuse() -> None:
    bare = "apiVersion: robotoffload.dev/v1alpha1\nkind: RobotOffload\nmetadata: {name: t}\nspec:\n"
    done = run("render", "-", stdin=bare + "  nodes: [{name: talker, placement: Cloud}]\n")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "spec.nodes[0].image" in done.stderr


def test_a_folder_means_all_specifications_in_it(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "talker.yaml").write_text((SAMPLES / "talker.yaml").read_text())
    (tmp_path / "service.yaml").write_text("apiVersion: v1\nkind: Service\n")
    (tmp_path / "notes.txt").write_text("RobotOffload")
    done = run("validate", str(tmp_path))
    assert done.exit_code == 0
    assert done.stdout.splitlines() == [f"{tmp_path}/deep/talker.yaml: talker is valid, nodes: 2, collected outputs: 1"]
    (tmp_path / "deep" / "talker.yaml").unlink()
    assert "there is no RobotOffload in this folder" in run("validate", str(tmp_path)).stderr


def test_every_sample_fits_a_cluster() -> None:
    done = run("validate", "--cluster", str(SAMPLES))
    assert done.exit_code == 0, done.stderr
    # Transports without certificates say so, in the samples as well.
    assert all(" warning: spec.transport.type: " in line for line in done.stderr.splitlines()), done.stderr


@pytest.mark.usefixtures("no_cluster")
@pytest.mark.parametrize(
    "command",
    [
        ("status",),
        ("status", "w"),
        ("explain", "w"),
        ("bundle", "w", "-o", "out"),
        ("pin", "w", "robot"),
        ("revoke", "w", "--yes"),
    ],
)
def test_without_a_cluster_commands_say_so_and_never_show_a_traceback(command: tuple[str, ...]) -> None:
    done = run(*command)
    assert done.exit_code in (1, 2)
    assert not done.stdout
    assert "--kubeconfig" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("no_cluster")
def test_doctor_goes_on_without_a_cluster() -> None:
    done = run("doctor")
    assert done.exit_code == 1
    assert "ERROR   ApiServer" in done.stdout
    assert "FileDescriptors" in done.stdout
    assert "ApiServer" not in run("doctor", "--local").stdout
    assert run("doctor", "--local", "w").exit_code == 2


@pytest.mark.parametrize(
    "command",
    [
        ("pin", "w", "edge"),
        ("pin", "w"),
        ("bundle", "w"),
        ("bundle", "w", "-o", "x", "--timeout", "soon"),
        ("explain",),
    ],
)
def test_a_command_line_that_is_wrong_ends_with_2(command: tuple[str, ...]) -> None:
    assert run(*command).exit_code == 2


def test_pinning_tells_what_it_means_now() -> None:
    before, after = manifest(), manifest()
    after["metadata"]["generation"] = 4
    after["spec"]["switching"]["pin"] = "Robot"
    assert told(observe(before), observe(after)) == ["wheelchair-7: held on the robot (the pin was Auto); generation 4"]
    assert told(observe(after), observe(after)) == ["wheelchair-7: the pin is Robot already; nothing was changed"]
    before["status"]["robot"]["connected"] = False
    after["spec"]["switching"]["mode"] = "Observe"
    lines = told(observe(before), observe(after))
    assert "not connected" in lines[1]
    assert "Observe" in lines[2]


def test_a_pin_for_some_time_writes_its_end_and_says_it() -> None:
    now = datetime.datetime(2026, 11, 23, 12, 0, tzinfo=datetime.UTC)
    text = end("Robot", "10m", now)
    assert text == "Robot 2026-11-23T12:10:00Z"
    assert end("Robot", None, now) is None
    before, after = manifest(), manifest()
    after["metadata"]["annotations"] = {PINNED_UNTIL: text}
    after["spec"]["switching"]["pin"] = "Robot"
    (line,) = told(observe(before), observe(after))
    assert line.startswith("wheelchair-7: held on the robot until 2026-11-23T12:10:00+00:00 (the pin was Auto)")
    after["status"]["pin"] = {"side": "Auto", "ended": text}
    assert observe(after).pin == "Auto"


@pytest.mark.parametrize(("side", "lasting"), [("auto", "10m"), ("robot", "soon"), ("cloud", "0s"), ("robot", "721h")])
def test_a_time_that_no_pin_can_last_is_refused_before_anything_is_asked(side: str, lasting: str) -> None:
    refused = run("pin", "w", side, "--for", lasting)
    assert refused.exit_code == 2
    assert "--for: " in refused.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_is_made_for_each_shell(shell: str) -> None:
    script = run("completion", shell).stdout
    assert "_ROBOT_OFFLOAD_COMPLETE" in script
    assert run("completion", "csh").exit_code == 2


def test_bash_completes_commands_and_values(tmp_path: Path) -> None:
    script = tmp_path / "complete.bash"
    script.write_text(run("completion", "bash").stdout)

    def completed(*words: str) -> set[str]:
        question = (
            f"source {script}; COMP_WORDS=({' '.join(words)} ''); COMP_CWORD={len(words)}; "
            '_robot_offload_completion robot-offload; printf "%s\\n" "${COMPREPLY[@]}"'
        )
        environment = {**os.environ, "PATH": f"{PROGRAMS}:{os.environ['PATH']}"}
        done = subprocess.run(
            ["bash", "-c", question], capture_output=True, text=True, timeout=120, check=True, env=environment
        )
        return set(done.stdout.split())

    assert set(COMMANDS) <= completed("robot-offload")
    assert completed("robot-offload", "completion") == {"bash", "zsh", "fish", "kubectl"}


def test_kubectl_gets_an_answer_for_its_plugin(tmp_path: Path) -> None:
    script = tmp_path / "kubectl_complete-offload"
    script.write_text(run("completion", "kubectl").stdout)
    environment = {**os.environ, "PATH": f"{PROGRAMS}:{os.environ['PATH']}"}

    def answered(*words: str) -> list[str]:
        done = subprocess.run(
            ["sh", str(script), *words], capture_output=True, text=True, timeout=120, check=True, env=environment
        )
        return done.stdout.split()

    assert answered("pi") == ["pin", ":4"]
    assert answered("pin", "walker", "") == ["robot", "cloud", "auto", ":4"]
