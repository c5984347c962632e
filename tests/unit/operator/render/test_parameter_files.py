"""Users' parameter files: a replica finds its parameters under its own name, and nothing else in the text changes."""

from __future__ import annotations

import pytest

from robot_offload.render.parameter_files import renamed
from tests.unit.operator.render.given import facts, offload, pods, rendered

FILE = """\
# tuned in the lab
controller:
  ros__parameters:
    frequency: 20.0   # Hz
    tolerance: 1e-3
    enabled: on
    controller: {speed: 1.0}
/chair/controller: {ros__parameters: {a: 010}}
chair:
  controller:
    ros__parameters: {b: "x"}
controller_other:
  ros__parameters: {c: 1}
/**:
  ros__parameters: {use_sim_time: false}
"""
FROM_FILE = {"nodes.1.run.parametersFrom": {"configMapKeyRef": {"name": "nav", "key": "nav.yaml"}}}
CONFIG = "ConfigMap/wheelchair-7-controller"
DEPLOYMENT = "Deployment/wheelchair-7-controller"


def test_only_the_keys_of_this_node_change() -> None:
    changed = renamed(FILE, "controller", "remote_controller")
    before, after = FILE.splitlines(), changed.splitlines()
    assert [(old, new) for old, new in zip(before, after, strict=True) if old != new] == [
        ("controller:", "remote_controller:"),
        ("/chair/controller: {ros__parameters: {a: 010}}", "/chair/remote_controller: {ros__parameters: {a: 010}}"),
        ("  controller:", "  remote_controller:"),
    ]


def test_a_quoted_key_is_changed_too() -> None:
    assert renamed('"/a/n": {ros__parameters: {}}\n', "n", "remote_n") == "/a/remote_n: {ros__parameters: {}}\n"


@pytest.mark.parametrize("text", ["", "a: [", "just text", "- list", "n: 5\n", "&a n: {x: *a}", "\0"])
def test_what_is_no_parameter_file_comes_back_as_it_is(text: str) -> None:
    assert renamed(text, "n", "remote_n") == text


def test_a_replica_mounts_a_copy_with_its_name() -> None:
    known = facts(user_configs={"nav/nav.yaml": FILE}, user_config_hashes={"nav/nav.yaml": "1"})
    manifests = rendered(offload(FROM_FILE), known)
    assert manifests[CONFIG]["data"]["nav.yaml"].splitlines()[1] == "remote_controller:"
    [volume] = [one for one in pods(manifests)[DEPLOYMENT]["spec"]["volumes"] if one["name"] == "parameters"]
    assert volume["configMap"]["name"] == "wheelchair-7-controller"


def test_a_node_that_keeps_its_name_mounts_the_users_own() -> None:
    known = facts(user_configs={"nav/nav.yaml": FILE})
    from_file = {"nodes.2.run.parametersFrom": FROM_FILE["nodes.1.run.parametersFrom"]}
    manifests = rendered(offload(from_file), known)
    assert CONFIG not in manifests
    [volume] = [
        one for one in pods(manifests)["Deployment/wheelchair-7-planner"]["spec"]["volumes"] if "configMap" in one
    ]
    assert volume["configMap"]["name"] == "nav"
