"""Options become a specification, and its problems are told with the options' names."""

from __future__ import annotations

import pytest

from robot_offload.errors import InputError
from robot_offload.images.flags import ALL_FLAGS, NODE_FLAGS, node_spec, overlay_spec
from robot_offload.images.spec import BuildSpec, GitSource

NODE = {"--workspace": ["src"], "--package": "controller", "--executable": "server"}


def test_every_field_of_a_specification_can_be_set_by_an_option() -> None:
    fields = {flag.field.split(".")[0] for flag in NODE_FLAGS}
    assert fields == {BuildSpec.model_fields[name].alias for name in BuildSpec.model_fields}
    assert {flag.field for flag in NODE_FLAGS if flag.field.startswith("git.")} == {
        f"git.{GitSource.model_fields[name].alias}" for name in GitSource.model_fields
    }


def test_every_option_has_a_help_text_that_ends_like_a_sentence() -> None:
    assert [flag.option for flag in ALL_FLAGS if not flag.help.endswith(".")] == []


def test_variables_and_labels_are_split_at_their_first_equals_sign() -> None:
    spec = node_spec(NODE | {"--env": ["A=b=c", "EMPTY="], "--label": ["team=x=y"]}, {}, "options")
    assert [(variable.name, variable.value) for variable in spec.env] == [("A", "b=c"), ("EMPTY", "")]
    assert spec.labels == {"team": "x=y"}
    with pytest.raises(InputError, match="--env: 'A' has no equals sign"):
        node_spec(NODE | {"--env": ["A"]}, {}, "options")


def test_options_win_over_the_block_of_a_file_field_by_field() -> None:
    block = {
        "git": {"url": "https://git.example/a", "ref": "old"},
        "package": "controller",
        "executable": "server",
        "aptPackages": ["curl"],
    }
    spec = node_spec({"--ref": "new", "--apt-package": ["jq"]}, block, "build.yaml")
    assert spec.git == GitSource(url="https://git.example/a", ref="new")
    assert spec.apt_packages == ("jq",)


def test_a_problem_names_the_option_or_the_field_of_the_file() -> None:
    with pytest.raises(InputError, match=r"options: --apt-package: 'x;y' is not possible here"):
        node_spec(NODE | {"--apt-package": ["x;y"]}, {}, "options")
    with pytest.raises(InputError, match=r"build.yaml: aptPackages\[0\]: 'x;y' is not possible here"):
        node_spec(NODE, {"aptPackages": ["x;y"]}, "build.yaml")


def test_options_of_the_other_kind_of_image_are_refused() -> None:
    with pytest.raises(InputError, match="--from: goes with --agent only"):
        node_spec(NODE | {"--from": "image:1"}, {}, "options")
    with pytest.raises(InputError, match="--git: does not go with --agent"):
        overlay_spec({"--from": "image:1", "--git": "https://git.example/a"}, "agent:1")
    assert overlay_spec({"--from": "image:1"}, "agent:1").agent_image == "agent:1"
    assert overlay_spec({"--from": "image:1", "--agent-image": "mine:2"}, "agent:1").agent_image == "mine:2"


def test_an_unknown_or_missing_field_of_a_block_is_told_with_the_right_one() -> None:
    with pytest.raises(InputError) as told:
        node_spec({}, {"workspace": {}, "aptPackage": ["jq"], "executable": "server"}, "build.yaml")
    assert "build.yaml: aptPackage: is not a known field; did you mean aptPackages?" in told.value.lines
    assert any(line.startswith("build.yaml: package: is missing (The package of the node") for line in told.value.lines)
