"""The rules between fields, each told with its field, a reason and what to do."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.errors import SpecError
from robot_offload.images.distros import DISTROS
from robot_offload.images.dockerfiles import check, dockerfile
from robot_offload.images.spec import OverlaySpec, parse
from tests.unit.operator.images import parsed
from tests.unit.operator.images.specs import build_spec

GIT = {"url": "https://git.example/robot.git", "ref": "8a5b1c2d3e4f5a6b7c8d9e0f1a2b3c4d5e6f7a8b"}


@pytest.mark.parametrize(
    ("changes", "path", "words"),
    [
        ({"workspace": None}, "", "exactly one source, found none"),
        ({"git": GIT}, "", "found git and workspace"),
        ({"executable": None}, "executable", "either executable or launch, found none"),
        ({"launch": "a.launch.py"}, "executable", "found both"),
        ({"rmw": "rmw_gurumdds_cpp"}, "rmw", "is not packaged for jazzy"),
        ({"distro": "foxy", "rmw": "rmw_zenoh_cpp"}, "rmw", "is not packaged for foxy"),
        ({"autostart": True}, "node", "is missing"),
        ({"healthCheck": "Present"}, "node", "is missing"),
        (
            {"executable": None, "launch": "a.launch.py", "autostart": True, "node": "/a"},
            "autostart",
            "starts several nodes",
        ),
        ({"env": [{"name": "HOME", "value": "/root"}]}, "env[0].name", "HOME is set by the image"),
        ({"env": [{"name": "ROS_DOMAIN_ID", "value": "1"}]}, "env[0].name", "use environment.domainID"),
        ({"env": [{"name": "A"}, {"name": "A"}]}, "env[1].name", "A is there twice"),
        ({"labels": {"dev.robotoffload.distro": "x"}}, "labels.dev.robotoffload.distro", "are set by the image"),
        (
            {"distro": "humble", "environment": {"staticPeers": ["a"]}},
            "environment.staticPeers",
            "humble does not know it",
        ),
        ({"environment": {"staticPeers": ["a:7400"]}}, "environment.staticPeers[0]", "have no ports"),
        (
            {"environment": {"staticPeers": ["a"], "discoveryRange": "Off"}},
            "environment.discoveryRange",
            "would not ask the static peers",
        ),
        ({"workspace": None, "git": GIT | {"credentials": "SSH"}}, "git.credentials", "SSH is for ssh://"),
        (
            {"workspace": None, "git": {"url": "git@git.example:robot.git", "credentials": "Token"}},
            "git.credentials",
            "Token is for addresses with https://",
        ),
        (
            {"workspace": None, "git": {"url": "git@git.example:robot.git"}},
            "git.credentials",
            "is read through ssh",
        ),
    ],
)
def test_fields_that_do_not_fit_each_other_are_refused(changes: dict[str, Any], path: str, words: str) -> None:
    with pytest.raises(SpecError) as refused:
        dockerfile(build_spec(**changes))
    assert [finding.path for finding in refused.value.findings][:1] == [path]
    assert words in refused.value.findings[0].message


@pytest.mark.parametrize(
    ("changes", "path", "words"),
    [
        ({"distro": "foxy"}, "distro", "end of life"),
        ({"distro": "rolling"}, "distro", "pin its images by digest"),
        ({"workspace": None, "git": GIT | {"ref": "main"}}, "git.ref", "is not a commit"),
        ({"env": [{"name": "API_TOKEN", "value": "x"}]}, "env[0].name", "looks like a secret"),
    ],
)
def test_what_is_possible_but_unwise_is_told(changes: dict[str, Any], path: str, words: str) -> None:
    spec = build_spec(**changes)
    warnings = check(spec)
    assert [(finding.path, finding.severity) for finding in warnings] == [(path, "warning")]
    assert words in warnings[0].message
    assert dockerfile(spec)


def test_a_pinned_source_of_a_supported_distribution_has_no_warning() -> None:
    assert check(build_spec(workspace=None, git=GIT)) == ()


@pytest.mark.parametrize(
    "url",
    [
        "https://user:password@git.example/robot.git",
        "https://token@git.example/robot.git",
        "ssh://git:password@git.example/robot.git",
        "http://git.example/robot.git",
        "git://git.example/robot.git",
        "ext::sh -c touch",
        "file://localhost/srv",
    ],
)
def test_an_address_with_a_password_or_an_unsafe_protocol_is_refused(url: str) -> None:
    with pytest.raises(SpecError):
        build_spec(workspace=None, git={"url": url})


def test_the_official_images_are_the_defaults_and_a_given_base_counts_for_both() -> None:
    assert build_spec().build_image == "docker.io/library/ros:jazzy"
    assert build_spec().runtime_image == "docker.io/library/ros:jazzy-ros-core"
    assert build_spec(base="mine:1").runtime_image == "mine:1"
    assert build_spec(base="mine:1", runtimeBase="small:1").runtime_image == "small:1"


def test_credentials_never_become_arguments_or_variables_of_the_image() -> None:
    for url, kind in ((GIT["url"], "Token"), ("git@git.example:robot.git", "SSH")):
        text = dockerfile(build_spec(workspace=None, git={"url": url, "ref": GIT["ref"], "credentials": kind}))
        names = {name for name, _ in parsed.instructions(text)}
        assert "ARG" not in names
        assert "--mount=type=secret" in text
        assert not any("secret" in value for name, value in parsed.instructions(text) if name in ("ENV", "LABEL"))


def test_two_projects_never_share_object_files() -> None:
    one = dockerfile(build_spec(workspace=None, git=GIT))
    other = dockerfile(build_spec(workspace=None, git=GIT | {"url": "https://git.example/other.git"}))
    caches = [{part for part in text.split() if "robot-offload-build-" in part} for text in (one, other)]
    assert caches[0] & caches[1] == set()


def test_only_foxy_is_stopped_with_sigint_and_so_is_every_launch_file() -> None:
    for distro in DISTROS:
        text = dockerfile(build_spec(distro=distro))
        assert ("STOPSIGNAL", "SIGINT" if distro == "foxy" else "SIGTERM") in parsed.instructions(text)
    assert ("STOPSIGNAL", "SIGINT") in parsed.instructions(
        dockerfile(build_spec(executable=None, launch="robot.launch.py"))
    )


def test_an_overlay_must_add_something() -> None:
    with pytest.raises(SpecError, match="--from"):
        dockerfile(parse(OverlaySpec, {"agentImage": "agent:1"}, "test"))
