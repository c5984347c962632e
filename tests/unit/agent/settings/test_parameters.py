"""The parameter file: every bad value is named, defaults are the product's, and what works together is checked."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.main import main
from robot_offload_agent.settings import parameters, topics
from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings

LEAST: dict[str, Any] = {"side": "robot", "uid": "walker-1"}
ONE_OF_EACH: dict[str, Any] = {
    **LEAST,
    "nodes": ["walker"],
    "outputs": ["command"],
    "output.command.topic": "/command",
    "output.command.robot_topic": "/offload/robot/command",
    "output.command.cloud_topic": "/offload/cloud/command",
    "inputs": ["scan"],
    "input.scan.topic": "/scan",
}


def problems(**different: Any) -> list[str]:
    """The lines of what is wrong; dots in names are written as double underscores here."""
    given = {**ONE_OF_EACH, **{key.replace("__", "."): value for key, value in different.items()}}
    try:
        parameters.parse(given)
    except ConfigurationError as error:
        return str(error).splitlines()
    return []


def test_side_and_identity_are_enough() -> None:
    configuration = parameters.parse(LEAST)
    assert configuration.side is Site.ROBOT
    assert configuration.nodes == configuration.outputs == configuration.inputs == ()
    assert configuration.settings() == Settings()


def test_what_is_not_given_has_the_default_of_the_table() -> None:
    configuration = parameters.parse(ONE_OF_EACH)
    assert configuration.outputs[0]["deadline_ms"] == topics.OUTPUT["deadline_ms"].default
    assert configuration.inputs[0]["latched"] is False
    assert configuration.nodes[0]["standby_robot"] == "Warm"


@pytest.mark.parametrize("missing", ["side", "uid", "output.command.topic", "input.scan.topic"])
def test_what_has_no_default_must_be_given(missing: str) -> None:
    with pytest.raises(ConfigurationError, match=f"parameter {missing}: must be given"):
        parameters.parse({key: value for key, value in ONE_OF_EACH.items() if key != missing})


def test_all_problems_are_told_at_once_one_line_each() -> None:
    told = problems(mode="Sometimes", lease_ms=-1.0, uid="a b", side="moon", typo=1, input__scan__topic="scan")
    assert {line.split(":")[0] for line in told} == {
        f"parameter {name}" for name in ("mode", "lease_ms", "uid", "side", "typo", "input.scan.topic")
    }


def wrong_values(parameter: parameters.Parameter) -> st.SearchStrategy[Any]:
    """Values that this parameter must not accept."""
    others = {
        bool: st.one_of(st.integers(), st.text(), st.floats()),
        int: st.one_of(st.booleans(), st.text(), st.floats()),
        float: st.one_of(st.booleans(), st.text(), st.lists(st.floats()), st.just(float("nan"))),
        str: st.one_of(st.booleans(), st.integers(), st.floats(), st.lists(st.text())),
        list: st.one_of(st.text(), st.integers(), st.lists(st.integers(), min_size=1)),
    }[parameter.type]
    if parameter.low is not None and parameter.high is not None:
        outside = st.one_of(
            st.floats(max_value=parameter.low, exclude_max=True), st.floats(min_value=parameter.high, exclude_min=True)
        )
        others = st.one_of(others, outside.map(parameter.type) if parameter.type is float else st.nothing())
    if parameter.choices or parameter.pattern:
        others = st.one_of(others, st.text(alphabet=" \n\t{}", min_size=1))
    return others


@pytest.mark.parametrize("name", parameters.GENERAL)
@given(data=st.data())
def test_a_value_of_another_type_or_out_of_range_is_named(name: str, data: st.DataObject) -> None:
    value = data.draw(wrong_values(parameters.GENERAL[name]))
    with pytest.raises(ConfigurationError) as raised:
        parameters.parse({**ONE_OF_EACH, name: value})
    assert any(line.startswith(f"parameter {name}: ") for line in str(raised.value).splitlines())


ANYTHING = st.none() | st.integers() | st.floats() | st.text()


@given(st.dictionaries(st.sampled_from(sorted(parameters.GENERAL)), ANYTHING))
def test_whatever_is_given_is_refused_by_name_or_works_together(different: dict[str, Any]) -> None:
    told = problems(**different)
    assert all(line.startswith("parameter ") for line in told)
    if not told:
        parameters.parse({**ONE_OF_EACH, **different}).settings().check()


def test_whole_numbers_are_taken_for_numbers_with_a_point() -> None:
    assert parameters.parse({**LEAST, "lease_ms": 300})["lease_ms"] == 300.0


def test_values_that_cannot_work_together_name_the_parameter() -> None:
    assert problems(lease_ms=100.0)[0].startswith("parameter lease_ms: must be at least")
    assert problems(loss_timeout_ms=30.0, heartbeat_period_ms=20.0)[0].startswith("parameter loss_timeout_ms:")


def test_a_topic_can_be_used_once_only() -> None:
    assert "round in circles" in problems(input__scan__topic="/command")[0]
    assert "round in circles" in problems(output__command__robot_topic="/command")[0]


def test_a_deadline_must_exceed_the_period_of_its_output() -> None:
    told = problems(output__command__rate_hz=5.0, output__command__deadline_ms=150.0)
    assert told == ["parameter output.command.deadline_ms: must exceed the period, 200 ms at 5 Hz"]


def test_an_output_names_a_node_that_there_is() -> None:
    assert problems(output__command__node="nobody")[0].startswith("parameter output.command.node: nobody")


@pytest.mark.parametrize(("group", "names"), [("nodes", ["a b"]), ("outputs", ["a/b"]), ("inputs", [""])])
def test_names_in_lists_have_a_form(group: str, names: list[str]) -> None:
    assert any(line.startswith(f"parameter {group}: ") for line in problems(**{group: names}))


def test_a_name_given_twice_is_refused() -> None:
    assert problems(nodes=["walker", "walker"]) == ["parameter nodes: each name once, found walker, walker"]


def test_nested_blocks_and_dotted_names_mean_the_same(tmp_path: Path) -> None:
    nested = tmp_path / "nested.yaml"
    block = {"side": "cloud", "uid": "w", "inputs": ["scan"], "input": {"scan": {"topic": "/scan"}}}
    nested.write_text(yaml.safe_dump({"/**": {"ros__parameters": block}}))
    dotted = tmp_path / "dotted.yaml"
    block = {"side": "cloud", "uid": "w", "inputs": ["scan"], "input.scan.topic": "/scan"}
    dotted.write_text(yaml.safe_dump({"/**": {"ros__parameters": block}}))
    assert parameters.load(nested) == parameters.load(dotted)


@pytest.mark.parametrize("text", ["", "[1, 2", "/**: 3", "/**: {ros__parameters: []}", "a: {b: c}"])
def test_a_file_that_is_no_agent_configuration_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=str(path)):
        parameters.load(path)


def test_the_command_says_each_problem_in_a_line_and_ends_with_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {**LEAST, "lease_ms": "long", "mode": 3}}}))
    assert main(["robot", "--params", str(path), "--check"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert [line.split(":")[:2] for line in told] == [
        ["robot-offload-agent", " parameter mode"],
        ["robot-offload-agent", " parameter lease_ms"],
    ]


def test_the_file_of_the_other_side_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": LEAST}}))
    assert main(["cloud", "--params", str(path)]) == 2
    assert "parameter side: the file is for the robot" in capsys.readouterr().err


def test_each_side_manages_the_nodes_that_run_there_and_has_its_own_standby() -> None:
    given = {
        **LEAST,
        "nodes": ["driver", "walker"],
        "node.driver.duplicated": False,
        "node.walker.standby_cloud": "Hot",
    }
    robot = parameters.parse(given).node_specs()
    cloud = parameters.parse({**given, "side": "cloud"}).node_specs()
    assert [(n.name, n.hot) for n in robot] == [("driver", False), ("walker", False)]
    assert [(n.name, n.hot) for n in cloud] == [("driver", False), ("walker", True)]


def test_a_node_that_runs_in_the_cloud_only_is_never_core() -> None:
    given = {**LEAST, "side": "cloud", "nodes": ["mapper"], "node.mapper.duplicated": False, "node.mapper.core": True}
    assert [node.core for node in parameters.parse(given).node_specs()] == [False]


def test_an_output_that_is_not_rated_has_no_deadline() -> None:
    assert parameters.parse(ONE_OF_EACH).output_specs()[0].deadline_s == 0.0
    rated = parameters.parse({**ONE_OF_EACH, "output.command.rate_hz": 20.0})
    assert rated.output_specs()[0].deadline_s == pytest.approx(0.150)
