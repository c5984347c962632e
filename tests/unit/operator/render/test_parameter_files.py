"""Users' parameter files: a replica finds its parameters under its own name, and nothing else in the text changes."""

from __future__ import annotations

import pytest

from robot_offload.render.parameter_files import MAX_FILE, TooLargeError, renamed, renamed_files
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
CONFIG = "ConfigMap/wheelchair-7-renamed-parameters"
N = (("n", "remote_n"),)
DEPLOYMENT = "Deployment/wheelchair-7-controller"


def test_only_the_keys_of_this_node_change() -> None:
    changed = renamed(FILE, (("controller", "remote_controller"),))
    before, after = FILE.splitlines(), changed.splitlines()
    assert [(old, new) for old, new in zip(before, after, strict=True) if old != new] == [
        ("controller:", "remote_controller:"),
        ("/chair/controller: {ros__parameters: {a: 010}}", "/chair/remote_controller: {ros__parameters: {a: 010}}"),
        ("  controller:", "  remote_controller:"),
    ]


def test_a_quoted_key_is_changed_too() -> None:
    assert renamed('"/a/n": {ros__parameters: {}}\n', N) == "/a/remote_n: {ros__parameters: {}}\n"


@pytest.mark.parametrize("text", ["", "a: [", "just text", "- list", "n: 5\n", "&a n: {x: *a}", "\0"])
def test_what_is_no_parameter_file_comes_back_as_it_is(text: str) -> None:
    assert renamed(text, N) == text


def test_a_replica_mounts_a_copy_with_its_name() -> None:
    known = facts(user_configs={"nav/nav.yaml": FILE}, user_config_hashes={"nav/nav.yaml": "1"})
    manifests = rendered(offload(FROM_FILE), known)
    assert manifests[CONFIG]["data"]["nav_nav.yaml"].splitlines()[1] == "remote_controller:"
    [volume] = [one for one in pods(manifests)[DEPLOYMENT]["spec"]["volumes"] if one["name"] == "parameters"]
    assert volume["configMap"] == {
        "name": "wheelchair-7-renamed-parameters",
        "items": [{"key": "nav_nav.yaml", "path": "nav.yaml"}],
    }


def test_a_node_that_keeps_its_name_mounts_the_users_own() -> None:
    known = facts(user_configs={"nav/nav.yaml": FILE})
    from_file = {"nodes.2.run.parametersFrom": FROM_FILE["nodes.1.run.parametersFrom"]}
    manifests = rendered(offload(from_file), known)
    assert CONFIG not in manifests
    [volume] = [
        one for one in pods(manifests)["Deployment/wheelchair-7-planner"]["spec"]["volumes"] if "configMap" in one
    ]
    assert volume["configMap"]["name"] == "nav"


def test_all_nodes_of_a_file_are_renamed_in_one_copy() -> None:
    text = "a: {ros__parameters: {x: 1}}\nb: {ros__parameters: {x: 2}}\nc: {ros__parameters: {x: 3}}\n"
    assert renamed(text, (("a", "remote_a"), ("b", "remote_b"))) == text.replace("a: ", "remote_a: ", 1).replace(
        "b: ", "remote_b: ", 1
    )


def test_an_alias_of_parameters_is_renamed_where_it_is_used() -> None:
    text = "other: &p {ros__parameters: {x: 1}}\nn: *p\n"
    assert renamed(text, N) == text.replace("n: *p", "remote_n: *p")


@pytest.mark.parametrize("bomb", ["[" * 200_000, "{a: " * 60_000, "- " * 100_000, "? " * 100_000])
def test_a_file_that_nests_without_end_is_given_up_at_once(bomb: str) -> None:
    assert renamed(bomb, N) == bomb  # read to its end, the first one takes minutes


def test_a_file_of_laughs_is_read_once_and_not_multiplied() -> None:
    laughs = "a0: &a0 {ros__parameters: {}}\n" + "".join(
        f"a{level}: &a{level} {{x: *a{level - 1}, y: *a{level - 1}}}\n" for level in range(1, 60)
    )
    assert renamed(laughs, N) == laughs


@pytest.mark.parametrize(
    ("sizes", "named"), [((MAX_FILE + 1,), "nav/0.yaml has"), ((MAX_FILE,) * 4, "1048576 bytes together")]
)
def test_files_that_are_too_large_are_refused_with_the_limit(sizes: tuple[int, ...], named: str) -> None:
    one = offload(FROM_FILE).spec.cloud_nodes[0]
    assert one.run is not None
    keys = [f"{number}.yaml" for number in range(len(sizes))]
    nodes = [
        {
            "name": f"n{number}",
            "placement": "Duplicated",
            "image": "n:1",
            "run": {
                "package": "p",
                "executable": "e",
                "parametersFrom": {"configMapKeyRef": {"name": "nav", "key": key}},
            },
        }
        for number, key in enumerate(keys)
    ]
    configs = {f"nav/{key}": "#" * size for key, size in zip(keys, sizes, strict=True)}
    with pytest.raises(TooLargeError, match=named):
        renamed_files(offload(nodes=nodes, topics={}).spec, configs)
