"""The commands `validate` and `render` as a user runs them: exit codes, standard output, standard error."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.unit.specs import MINIMAL, SAMPLE


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from robot_offload.cli.main import app; app(prog_name='robot-offload')"]
    return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture
def good(tmp_path: Path) -> Path:
    file = tmp_path / "good.yaml"
    file.write_text(SAMPLE)
    return file


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    file = tmp_path / "bad.yaml"
    file.write_text(
        SAMPLE.replace("lossTimeout: 90ms", "lossTimeout: 80ms").replace("lifecycle: false", "lifecycel: false")
    )
    return file


def test_a_good_file_ends_with_0(good: Path) -> None:
    done = run("validate", good)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{good}: wheelchair-7 is valid, nodes: 3, collected outputs: 1\n"


def test_a_bad_file_ends_with_2_and_a_line_for_each_problem(bad: Path) -> None:
    done = run("validate", bad)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"{bad}: spec.nodes[0].lifecycel: is not a known field; did you mean lifecycle?\n"


def test_warnings_are_told_and_do_not_refuse(tmp_path: Path) -> None:
    file = tmp_path / "talker.yaml"
    file.write_text(MINIMAL.replace("placement: Duplicated", "placement: Duplicated, core: true"))
    done = run("validate", file)
    assert done.returncode == 0
    assert [line.split(": ")[1] for line in done.stderr.splitlines()] == ["warning", "warning"]


def test_an_end_of_a_pin_that_is_none_is_a_warning(tmp_path: Path) -> None:
    file = tmp_path / "talker.yaml"
    ends = "metadata: {annotations: {robotoffload.dev/pinned-until: soon}, "
    file.write_text(MINIMAL.replace("metadata: {", ends))
    done = run("validate", file)
    assert done.returncode == 0
    assert "warning: metadata.annotations" in done.stderr
    assert "'soon' is not a valid end of a pin" in done.stderr


def test_json_tells_the_same_to_scripts(good: Path, bad: Path) -> None:
    accepted, refused = run("validate", "--json", good), run("validate", "--json", bad)
    assert (accepted.returncode, refused.returncode) == (0, 2)
    assert json.loads(accepted.stdout) == {
        "valid": True,
        "files": [{"file": str(good), "valid": True, "problems": []}],
    }
    assert json.loads(refused.stdout)["files"][0]["problems"] == [
        {
            "path": "spec.nodes[0].lifecycel",
            "reason": "UnknownField",
            "message": "is not a known field; did you mean lifecycle?",
            "severity": "error",
        }
    ]


@pytest.mark.parametrize(
    "arguments",
    [
        ("validate", "missing.yaml"),
        ("validate",),
        ("vaildate", "x.yaml"),
        ("render", "agent-config", "missing.yaml", "--side", "robot"),
        ("render", "agent-config", "missing.yaml", "--side", "edge"),
        ("render", "agent-config", "missing.yaml"),
    ],
)
def test_bad_input_ends_with_2_and_never_with_a_traceback(arguments: tuple[str, ...]) -> None:
    done = run(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert "Traceback" not in done.stderr
    assert done.stderr


def test_the_agent_configuration_goes_to_standard_output_or_to_a_file(good: Path, tmp_path: Path) -> None:
    out = tmp_path / "robot.yaml"
    printed = run("render", "agent-config", good, "--side", "robot", "--host", "edge.example", "--realtime")
    written = run(
        "render", "agent-config", good, "--side", "robot", "--host", "edge.example", "--realtime", "--output", out
    )
    assert (printed.returncode, written.returncode, written.stdout) == (0, 0, "")
    assert out.read_text() == printed.stdout
    parameters = yaml.safe_load(printed.stdout)["/**"]["ros__parameters"]
    assert parameters["realtime"] is True
    assert parameters["link"]["pulse_endpoints"] == ["quic/edge.example:7447"]
    assert parameters["link"]["ca"] == "certificates/server-ca.pem"
    assert parameters["link"]["private_key"] == "certificates/robot.key"


def test_the_clouds_agent_listens_on_every_address_by_default(good: Path) -> None:
    parameters = yaml.safe_load(run("render", "agent-config", good, "--side", "cloud").stdout)["/**"]["ros__parameters"]
    assert parameters["link"]["data_endpoints"] == ["quic/0.0.0.0:7448"]
    assert parameters["link"]["ca"] == "certificates/client-ca.pem"
    assert parameters["domain_id"] == 43


def test_an_output_file_that_cannot_be_written_is_bad_input(good: Path, tmp_path: Path) -> None:
    done = run("render", "agent-config", good, "--side", "robot", "--output", tmp_path / "missing" / "x.yaml")
    assert done.returncode == 2
    assert "cannot be written" in done.stderr


def test_many_files_are_checked_and_one_bad_one_refuses(good: Path, bad: Path) -> None:
    done = run("validate", good, bad)
    assert done.returncode == 2
    assert [line.split(": ")[0] for line in (done.stdout + done.stderr).splitlines()] == [str(good), str(bad)]


@pytest.mark.parametrize("command", [(), ("validate",), ("render",), ("render", "agent-config")])
def test_help_teaches_with_examples(command: tuple[str, ...]) -> None:
    done = run(*command, "--help")
    assert done.returncode == 0
    assert "Examples:\n    robot-offload" in done.stdout


def listed(*texts: str) -> str:
    return json.dumps({"apiVersion": "v1", "kind": "List", "items": [yaml.safe_load(text) for text in texts]})


def test_a_list_as_kubectl_writes_it_is_read_object_by_object(tmp_path: Path) -> None:
    file = tmp_path / "list.json"
    file.write_text(listed(SAMPLE, SAMPLE.replace("wheelchair-7", "wheelchair-8").replace("rosDistro", "rosDistrib")))
    done = run("validate", file)
    assert done.returncode == 2
    assert done.stdout == f"{file}: items[0]: wheelchair-7 is valid, nodes: 3, collected outputs: 1\n"
    assert done.stderr.startswith(f"{file}: items[1]: spec.robot.rosDistrib: is not a known field")


def test_an_empty_list_and_a_list_where_one_object_is_read_are_named(tmp_path: Path) -> None:
    file = tmp_path / "list.json"
    file.write_text(listed())
    assert run("validate", file).stderr == f"{file}: items: the list holds no object\n"
    file.write_text(listed(SAMPLE, SAMPLE))
    assert "a list of 2 objects" in run("render", file).stderr
    file.write_text(listed(SAMPLE))
    assert run("render", file).returncode == 0
