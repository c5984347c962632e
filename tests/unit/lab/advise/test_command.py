"""`robot-offload import --advise` from kept graphs: the table, the file that follows, the picture."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.api.files import load
from robot_offload.cli.main import app
from robot_offload.survey.snapshot import GraphSnapshot, write
from tests.unit.operator.survey.graphs import STRING, TWIST, graph, node, process, topic

SEEN = Path(__file__).resolve().parents[2] / "operator" / "survey" / "wheelchair.json"


def run(*words: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["import", "--advise", *words])
    return done.exit_code, done.stdout, done.stderr


def placements(file: Path) -> dict[str, str]:
    return {it.name: it.placement for it in load(file).spec.nodes}


def test_the_wheelchair_is_cut_as_its_authors_cut_it(tmp_path: Path) -> None:
    file, picture = tmp_path / "robot.yaml", tmp_path / "cuts.svg"
    code, _, said = run("--from", str(SEEN), "-o", str(file), "--picture", str(picture))
    assert code == 0, said
    own = {it.name: it.placement for it in load("examples/wheelchair/robotoffload.yaml").spec.nodes}
    assert placements(file) == own
    assert said.splitlines()[1].startswith("1. /controller, /localiser: saves 11.9% of a core")
    assert len(said.splitlines()) == 4, "three cuts"
    assert "# 1. /controller, /localiser" in file.read_text()
    assert "<svg" in picture.read_text()


def test_a_link_that_is_too_slow_for_the_loop_leaves_all_on_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    code, _, said = run("--from", str(SEEN), "--rtt", "90ms", "-o", str(file))
    assert code == 0
    assert "none: no node can leave the robot" in said
    assert set(placements(file).values()) == {"Robot"}
    assert run("--from", str(SEEN), "--rtt", "90ms", "--tolerance", "95ms", "-o", str(file), "--force")[0] == 0
    assert placements(file)["controller"] == "Duplicated"
    assert load(file).spec.switching.latency.tolerance_ms == 95, "the file keeps the rule that was asked for"


def detecting() -> GraphSnapshot:
    """A heavy detector without a lifecycle, a controller, wheels, a camera of 5 MB/s."""
    names = ("/camera", "/detector", "/controller", "/wheels", "/screen")
    nodes = [node(name, managed=name == "/controller") for name in names]
    topics = [
        topic("/image", "sensor_msgs/msg/Image", ["/camera"], ["/detector"], size=250_000),
        topic("/boxes", STRING, ["/detector"], ["/screen"]),
        topic("/cmd_vel", TWIST, ["/controller"], ["/wheels"]),
    ]
    processes = [
        process(at, f"/lib/x{name}", cpu=1.5 if name == "/detector" else 0.1) for at, name in enumerate(names, start=10)
    ]
    return graph(nodes, topics, processes)


def test_a_heavy_plain_node_leaves_for_the_cloud_where_the_link_carries_its_images(tmp_path: Path) -> None:
    seen, file = tmp_path / "graph.json", tmp_path / "robot.yaml"
    seen.write_text(write(detecting()))
    assert run("--from", str(seen), "--bandwidth", "100Mbit/s", "-o", str(file))[0] == 0
    assert placements(file)["detector"] == "Cloud"
    assert placements(file)["controller"] == "Duplicated"
    assert run("--from", str(seen), "--bandwidth", "10Mbit/s", "-o", str(file), "--force")[0] == 0
    assert placements(file)["detector"] == "Robot"


@pytest.mark.parametrize(
    ("words", "said"),
    [(("--bandwidth", "fast"), "write for example 20Mbit/s"), (("--bandwidth", "0Mbit/s"), "no bandwidth"),
     (("--rtt", "20"), "--rtt:"), (("--tolerance", "x"), "--tolerance:")],
)  # fmt: skip
def test_a_limit_that_cannot_be_read_ends_with_2(words: tuple[str, ...], said: str) -> None:
    code, _, problem = run("--from", str(SEEN), *words)
    assert code == 2
    assert said in problem


def test_json_without_a_picture_is_the_resource_alone() -> None:
    code, out, _ = run("--from", str(SEEN), "--json")
    assert code == 0
    assert json.loads(out)["kind"] == "RobotOffload"
