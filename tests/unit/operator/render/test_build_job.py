"""The build Job: who has which rights and secrets, and that nothing a user writes is ever run as a command."""

from __future__ import annotations

import json
from typing import Any

import pytest
import tomllib

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.decide.build_specs import build_plans, from_git
from robot_offload.errors import SpecError
from robot_offload.kube.port import Manifest
from robot_offload.objects.names import MAX_LENGTH
from robot_offload.objects.parent import Parent
from robot_offload.render import build_scripts as scripts
from robot_offload.render.build_job import build_files, build_job, build_ports
from robot_offload.render.network_policies import network_policies
from tests.unit.operator.render.given import facts, resource

BUILD: dict[str, Any] = {
    "git": {"url": "https://git.example/robot.git", "paths": ["src/a", "src/b"]},
    "package": "planner",
    "executable": "planner_server",
}
REGISTRY: dict[str, Any] = {
    "repository": "registry.example/fleet",
    "pushSecret": {"name": "push"},
    "pullSecret": {"name": "pull"},
}


def built(
    build: dict[str, Any] | None = None,
    registry: dict[str, Any] | None = None,
    name: str = "wheelchair-7",
    **cloud: Any,
) -> RobotOffload:
    """The sample with a planner that is built."""
    block = {**BUILD, **(build or {})}
    node = {"name": "planner", "placement": "Cloud", "run": {"command": ["planner"]}, "build": block}
    changes = {"nodes.2": node, "cloud": {"registry": {**REGISTRY, **(registry or {})}, **cloud}}
    return parse_object({**resource(changes), "metadata": {"name": name}}, "test.yaml")


def job(offload: RobotOffload) -> Manifest:
    [plan] = build_plans(offload, "")
    return build_job(Parent(offload, facts()), plan)


def pod_of(offload: RobotOffload) -> Manifest:
    spec: Manifest = job(offload)["spec"]["template"]["spec"]
    return spec


def containers(offload: RobotOffload) -> dict[str, Manifest]:
    pod = pod_of(offload)
    return {each["name"]: each for each in [*pod["initContainers"], *pod["containers"]]}


def secrets_seen_by(offload: RobotOffload) -> dict[str, set[str]]:
    """The names of the Secrets that each container mounts."""
    volumes = {
        volume["name"]: volume["secret"]["secretName"] for volume in pod_of(offload)["volumes"] if "secret" in volume
    }
    return {
        name: {volumes[mount["name"]] for mount in container["volumeMounts"] if mount["name"] in volumes}
        for name, container in containers(offload).items()
    }


def test_each_step_sees_its_own_secret_and_no_other() -> None:
    offload = built({"gitSecret": {"name": "git"}})
    assert secrets_seen_by(offload) == {"fetch": {"git"}, "build": {"pull"}, "push": {"push"}}


def test_without_secrets_none_is_mounted() -> None:
    offload = built(registry={"pushSecret": None, "pullSecret": None})
    assert secrets_seen_by(offload) == {"fetch": set(), "build": set(), "push": set()}


def test_what_pushes_unpacks_the_image_where_no_build_step_has_been() -> None:
    places = {
        name: {mount["name"] for mount in container["volumeMounts"] if mount["mountPath"] == "/var/tmp"}
        for name, container in containers(built()).items()
    }
    assert places == {"fetch": set(), "build": set(), "push": {"unpacked"}}


def test_what_sees_the_secret_of_the_source_runs_in_an_image_of_ours_whatever_a_user_names() -> None:
    offload = built({"base": "registry.example/git-that-steals", "gitSecret": {"name": "git"}})
    assert containers(offload)["fetch"]["image"] == facts().images.git
    assert {one["image"] for one in containers(offload).values()} == {facts().images.git, facts().images.builder}


@pytest.mark.parametrize(
    ("url", "entries"),
    [
        ("https://git.example/robot.git", ["username", "password"]),
        ("git@git.example:robot.git", ["ssh-privatekey", "known_hosts"]),
    ],
)
def test_of_a_secret_only_the_entries_of_its_type_are_mounted(url: str, entries: list[str]) -> None:
    offload = built({"git": {"url": url}, "gitSecret": {"name": "wheelchair-client-ca"}})
    volumes = {volume["name"]: volume["secret"] for volume in pod_of(offload)["volumes"] if "secret" in volume}
    assert [item["key"] for item in volumes["git"]["items"]] == entries
    assert all(volume["items"] for volume in volumes.values())


def test_only_buildah_has_more_than_the_restricted_level_allows_and_nobody_is_root() -> None:
    security = {name: container["securityContext"] for name, container in containers(built()).items()}
    assert security["fetch"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert security["fetch"]["capabilities"] == {"drop": ["ALL"]}
    assert not security["fetch"]["allowPrivilegeEscalation"]
    for name in ("build", "push"):
        assert security[name]["capabilities"] == {"drop": ["ALL"], "add": ["SETUID", "SETGID"]}
    for context in security.values():
        assert context["runAsUser"] > 0
        assert context["readOnlyRootFilesystem"]
        assert "privileged" not in context
    pod = pod_of(built())
    assert pod["automountServiceAccountToken"] is False
    assert pod["securityContext"]["runAsNonRoot"]
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(pod)
    assert not [volume for volume in pod["volumes"] if "hostPath" in volume]


def test_a_job_ends_is_not_repeated_in_a_loop_and_goes_away() -> None:
    spec = job(built())["spec"]
    assert (spec["backoffLimit"], spec["template"]["spec"]["restartPolicy"]) == (0, "Never")
    assert spec["activeDeadlineSeconds"] > 0
    assert spec["ttlSecondsAfterFinished"] > 0
    assert "finalizers" not in job(built())["metadata"]


def test_the_commands_are_the_same_whatever_a_user_writes() -> None:
    commands = {name: (one["command"], one["args"]) for name, one in containers(built()).items()}
    other = built(
        {
            "git": {"url": "https://x.example/;curl", "ref": "a+b", "paths": ["a b", "c"]}
            | {"url": "https://x.example/y"},
            "package": "other",
            "executable": "rm",
        },
        {"repository": "other.example:5000/a/b", "insecure": True},
    )
    assert {name: (one["command"], one["args"]) for name, one in containers(other).items()} == commands
    assert commands["fetch"][1] == [scripts.FETCH]


HOSTILE = [
    "$(reboot)",
    "`reboot`",
    "a\nb",
    "a;b",
    "a'b",
    'a"b',
    "--upload-pack=reboot",
    "-c",
    "a b\t",
    "a\u2028b",
    "a\0b",
    "",
]


@pytest.mark.parametrize("value", HOSTILE)
@pytest.mark.parametrize(
    "change",
    [
        lambda value: {"git": {"url": value}},
        lambda value: {"git": {"url": f"https://git.example/{value}"}},
        lambda value: {"git": {**BUILD["git"], "ref": value}},
        lambda value: {"git": {**BUILD["git"], "paths": [value]}},
        lambda value: {"package": value},
        lambda value: {"executable": value},
        lambda value: {"base": value},
        lambda value: {"aptPackages": [value]},
        lambda value: {"pipPackages": [value]},
        lambda value: {"cmakeArguments": [value]},
        lambda value: {"skipKeys": [value]},
        lambda value: {"packages": [value]},
        lambda value: {"gitSecret": {"name": value}},
    ],
)
def test_a_hostile_value_is_refused_or_only_ever_a_value(change: Any, value: str) -> None:
    try:
        offload = built(change(value))
    except SpecError:
        return
    for container in containers(offload).values():
        assert container["args"] in ([scripts.FETCH], [scripts.BUILD], [scripts.PUSH])
        assert all("\n" not in one["value"] or one["name"] == "GIT_PATHS" for one in container["env"])


@pytest.mark.parametrize(
    "repository", ["robots", "a.example/B", "a.example/x:1", 'a.example"/x', "a.example/x\ny", "//x"]
)
def test_a_repository_that_is_none_is_refused(repository: str) -> None:
    with pytest.raises(SpecError, match=r"registry\.repository"):
        built(registry={"repository": repository})


def test_the_settings_of_registries_are_toml_and_open_one_registry_only() -> None:
    offload = built(registry={"repository": "registry.local:5000/a", "insecure": True})
    [plan] = build_plans(offload, "")
    text = build_files(Parent(offload, facts()), plan)["data"][scripts.REGISTRIES]
    assert tomllib.loads(text)["registry"] == [{"location": "registry.local:5000", "insecure": True}]
    [safe] = build_plans(built(), "")
    assert "registry" not in tomllib.loads(build_files(Parent(built(), facts()), safe)["data"][scripts.REGISTRIES])


def test_the_dockerfile_is_that_of_the_command_line_with_a_folder_in_place_of_git() -> None:
    [plan] = build_plans(built(), "")
    assert "COPY" in plan.dockerfile
    assert "git fetch" not in plan.dockerfile
    assert "planner_server" in plan.dockerfile


def test_middleware_distribution_and_user_follow_from_the_resource() -> None:
    offload = built(rmw="rmw_fastrtps_dynamic_cpp", runAsUser=1234)
    [plan] = build_plans(offload, "")
    assert 'RMW_IMPLEMENTATION="rmw_fastrtps_dynamic_cpp"' in plan.dockerfile
    assert "USER 1234:1234" in plan.dockerfile
    assert "FROM docker.io/library/ros:jazzy" in plan.dockerfile


def test_the_key_is_that_of_the_source_and_not_of_the_robot_or_of_secrets() -> None:
    [first] = build_plans(built(), "")
    for same in (
        built({"resources": {"limits": {"memory": "4Gi"}}}),
        built(registry={"pushSecret": {"name": "other"}}),
        built(name="seven"),
    ):
        [plan] = build_plans(same, "")
        assert plan.key == first.key
    for other in (built({"git": {**BUILD["git"], "ref": "v2"}}), built({"aptPackages": ["gdb"]}), built(runAsUser=7)):
        [plan] = build_plans(other, "")
        assert plan.key != first.key
    [again] = build_plans(built(), "now")
    assert again.key != first.key


def test_names_fit_however_long_everything_is() -> None:
    offload = built({"package": "p" * 200}, name="r" * 63)
    [plan] = build_plans(offload, "")
    assert len(plan.name) <= MAX_LENGTH
    assert len(json.dumps(build_job(Parent(offload, facts()), plan))) < 100_000


@pytest.mark.parametrize(
    ("build", "registry", "ports"),
    [
        ({}, {}, (80, 443)),
        ({"git": {"url": "https://git.example:8443/a"}}, {}, (80, 443, 8443)),
        ({"git": {"url": "ssh://git@git.example:2222/a"}, "gitSecret": {"name": "a"}}, {}, (80, 443, 2222)),
        ({"git": {"url": "git@git.example:a/b"}, "gitSecret": {"name": "a"}}, {}, (22, 80, 443)),
        ({"base": "mirror.example:5001/ros:jazzy"}, {}, (80, 443, 5001)),
        ({"base": "ros:1"}, {"repository": "registry:5000"}, (80, 443, 5000)),
    ],
)
def test_builds_reach_the_ports_that_they_need(build: Any, registry: Any, ports: Any) -> None:
    assert build_ports(built(build, registry).spec) == ports


def test_nobody_may_call_a_build_and_it_may_call_declared_ports_only() -> None:
    policies = {policy["metadata"]["name"]: policy["spec"] for policy in network_policies(Parent(built(), facts()))}
    policy = policies["wheelchair-7-build"]
    assert policy["policyTypes"] == ["Ingress", "Egress"]
    assert "ingress" not in policy
    assert {port["port"] for rule in policy["egress"] for port in rule["ports"]} == {53, 80, 443}
    labels = job(built())["spec"]["template"]["metadata"]["labels"]
    assert policy["podSelector"]["matchLabels"].items() <= labels.items()


@pytest.mark.parametrize(
    ("build", "credentials"),
    [
        ({}, "None"),
        ({"gitSecret": {"name": "a"}}, "Token"),
        ({"git": {"url": "git@git.example:a"}, "gitSecret": {"name": "a"}}, "SSH"),
    ],
)
def test_outside_the_cluster_the_same_block_fetches_by_itself(build: Any, credentials: str) -> None:
    offload = built(build)
    [node] = offload.spec.built_nodes
    assert node.build is not None
    told = from_git(offload.spec, node, node.build)
    assert told.git is not None
    assert told.git.credentials == credentials
    assert told.workspace is None
