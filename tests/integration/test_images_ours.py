"""Our own images, really built on the wheels base: what they hold, what they need to run, and how they end."""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version

import pytest
import yaml

from robot_offload.render.build_scripts import FETCH, SCRATCH
from robot_offload.transport import discovery
from robot_offload_lab.images import ours
from tests.integration import images_machine
from tests.integration.images_machine import WAIT_S, Container, Machine, figure

pytestmark = [pytest.mark.images, pytest.mark.timeout(2400)]
REGISTRY = "localhost/robot-offload-test"
THIN = 8_000_000
"""Bytes: what a changed line of ours may cost a node that pulls the new image."""
PARAMETERS = """
/**:
  ros__parameters:
    side: cloud
    robot_name: walker-1
    uid: of-the-test
    domain_id: 88
    runtime_dir: /tmp/agent
    state_dir: /tmp/state
    realtime: false
    link.type: ros
    nodes: [walker]
"""
KUBECONFIG = """
apiVersion: v1
kind: Config
clusters: [{name: none, cluster: {server: "http://127.0.0.1:1"}}]
users: [{name: none, user: {}}]
contexts: [{name: none, context: {cluster: none, user: none}}]
current-context: none
"""


@dataclass(frozen=True)
class Program:
    """What runs in an image.

    Attributes:
        image: one of ours.
        command: as a pod gives it; empty: the image's own.
        process: what process 1 is then: the beginning of its command line.
        ready: a shell command that ends with 0 as soon as the program does its work.
        environment: beside the image's own.
        files: by their path in the container.
    """

    image: str
    command: tuple[str, ...]
    process: str
    ready: str
    environment: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


PROGRAMS = (
    Program(
        "agent",
        ("robot-offload-agent", "cloud", "--params", "/tmp/agent.yaml"),
        "python3 -m robot_offload_agent.main cloud",
        # The supervisor has started its processes.
        "test -n \"$(cat /proc/1/task/*/children)\" && test -n \"$(ls /tmp/agent)\"",
        files={"/tmp/agent.yaml": PARAMETERS},
    ),
    Program(
        "operator",
        (),
        "/opt/robot_offload/bin/python /opt/robot_offload/bin/robot-offload operator",
        "python3 -c 'import urllib.request as u; u.urlopen(\"http://127.0.0.1:8080/metrics\")'",
        {
            **{f"{name}_IMAGE": "image:1" for name in ("AGENT", "OPERATOR", "DISCOVERY", "ROUTER")},
            "POD_NAME": "operator", "POD_NAMESPACE": "test", "KUBECONFIG": "/tmp/kubeconfig",
        },
        {"/tmp/kubeconfig": KUBECONFIG},
    ),
    # The one shell that stays: it outlives the server, so that no successor begins too early (images/discovery/serve).
    Program(
        "discovery",
        (),
        "/bin/bash /opt/robot_offload/serve fast-discovery-server -i 0",
        "grep -q :2E23 /proc/net/udp",
    ),
)  # fmt: skip
IMAGES = sorted({"git", *(program.image for program in PROGRAMS)})
EXAMPLES = ("talker", "wheelchair")


@pytest.fixture(scope="module")
def machine() -> Iterator[Machine]:
    """A machine with our images."""
    with images_machine.machine("system", "ros-core") as machine:
        machine.run(
            sys.executable, "-m", "robot_offload_lab.images.ours", *IMAGES, *(f"examples/{name}" for name in EXAMPLES),
            "--wheels", "--builder", "buildah", "--registry", REGISTRY,
        )  # fmt: skip
        yield machine
        machine.run("buildah", "rmi", "--prune", check=False)


def named(image: str) -> str:
    """The name of one of our images here."""
    return f"{REGISTRY}/{image}:{version('robot-offload')}"


@pytest.mark.parametrize("image", IMAGES)
def test_it_says_what_it_is_and_holds_no_machine_id_no_sources_and_no_caches(machine: Machine, image: str) -> None:
    labels = machine.configuration(named(image))["Labels"]
    assert labels["org.opencontainers.image.title"] == f"robot-offload-{image}"
    assert labels["org.opencontainers.image.version"] == version("robot-offload")
    assert re.fullmatch(r"[0-9a-f]{40}|unknown", labels["org.opencontainers.image.revision"])
    with machine.mounted(named(image)) as root:
        assert (root / "etc/machine-id").read_text() == ""
        for folder in ("source", "code", "root/.cache/pip", "var/lib/apt/lists", "tmp"):
            assert not list((root / folder).glob("*")), f"/{folder} is empty"
        packages = {path.name for path in root.glob("opt/robot_offload/**/site-packages/*")}
        assert not {"matplotlib", "numpy", "pip"} & packages
    figure(f"size of {image}", machine.size(named(image)))
    figure(f"last layer of {image}", f"{machine.layers(named(image))[-1] / 1e6:.1f} MB")


@pytest.mark.parametrize("image", ["agent", "operator"])
def test_our_code_is_a_thin_last_layer(machine: Machine, image: str) -> None:
    assert machine.layers(named(image))[-1] < THIN


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.image)
def test_it_runs_without_root_on_a_read_only_root_and_ends_in_order(machine: Machine, program: Program) -> None:
    image = named(program.image)
    with machine.running(image, *program.command, environment=program.environment, files=program.files) as container:
        container.until(lambda: container.run("sh", "-c", program.ready).returncode == 0)
        assert is_not_root(container)
        assert container.run("touch", "/opt/robot_offload/x").returncode != 0, "the root file system is read-only"
        assert container.run("touch", "/tmp/x").returncode == 0
        words = container.run("cat", "/proc/1/cmdline").stdout.replace("\0", " ")
        assert words.startswith(program.process), "process 1 is the program itself, no start script"
        assert container.end() == 0, container.said()


def test_a_discovery_server_gets_sigterm_and_leaves_nothing_behind_while_its_pod_stays_away(machine: Machine) -> None:
    with machine.running(named("discovery")) as container:
        container.until(lambda: container.run("grep", "-q", ":2E23", "/proc/net/udp").returncode == 0)
        assert "fast-discovery-" in programs(container)
        begun = time.monotonic()
        container.signal("TERM")
        container.until(lambda: "fast-discovery-" not in programs(container))
        assert set(programs(container)) <= {"serve", "sleep", "sh", "cat"}, "no zombie of the server either"
        assert container.process.wait(WAIT_S) == 0, container.said()
        assert time.monotonic() - begun > discovery.GONE_S - 1


def programs(container: Container) -> list[str]:
    """The names of all processes of a container, those that have ended and were not waited for included."""
    return container.run("sh", "-c", "cat /proc/[0-9]*/comm").stdout.split()


def test_the_image_of_git_fetches_a_source_as_the_operator_asks_for_it(machine: Machine) -> None:
    """The operator's own script, with a repository in a folder: the test of the chain has a server."""
    work = ("git", "-c", "user.name=a", "-c", "user.email=a@b.example", "-C")
    source = "cd /tmp && git init -q r && echo hello > r/a && git -C r add a && " + " ".join(
        (*work, "r", "commit", "-qm", "a")
    )
    scratch = {"GIT_URL": "file:///tmp/r", "GIT_REF": "HEAD", "GIT_PATHS": ""}
    with machine.running(named("git"), "sleep", "600", environment=scratch) as container:
        assert is_not_root(container)
        assert container.run("git", "--version").returncode == 0
        assert "OpenSSH" in container.run("ssh", "-V").stderr
        assert container.run("sh", "-c", "test -s /etc/ssl/certs/ca-certificates.crt").returncode == 0
        assert container.run("touch", "/usr/x").returncode != 0, "the root file system is read-only"
        fetched = container.run("sh", "-c", f"{source} && {FETCH.replace(SCRATCH, '/tmp/scratch')}")
        assert fetched.returncode == 0, fetched.stderr
        assert "Fetched commit" in fetched.stdout
        assert container.run("cat", "/tmp/scratch/context/src/a").stdout == "hello\n"


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_image_of_an_example_runs_its_node_as_the_sample_asks_for_it(machine: Machine, name: str) -> None:
    sample = yaml.safe_load((ours.ROOT / "manifests" / "samples" / f"{name}.yaml").read_text(encoding="utf-8"))
    node = next(one for one in sample["spec"]["nodes"] if "image" in one)
    with machine.running(named(f"examples/{name}"), *node["run"]["command"]) as container:
        container.until(lambda: container.run("grep", "-q", "librmw_fastrtps", "/proc/1/maps").returncode == 0)
        words = container.run("cat", "/proc/1/cmdline").stdout.split("\0")
        assert words[:2] == node["run"]["command"]
        assert is_not_root(container)


def is_not_root(container: Container) -> bool:
    """Whether process 1 runs as user and group 1000, without any capability."""
    status = dict(line.split(":", 1) for line in container.run("cat", "/proc/1/status").stdout.splitlines())
    ids = {*status["Uid"].split(), *status["Gid"].split()}
    return ids == {"1000"} and int(status["CapEff"], 16) == 0


def test_the_agent_can_be_laid_over_an_image_of_a_user(machine: Machine) -> None:
    """`build --agent --from IMAGE`: the user's message package and the agent, both importable."""
    theirs, both = "localhost/theirs:1", "localhost/theirs-with-agent:1"
    context = machine.folder / "tmp" / "theirs"
    context.mkdir()
    (context / "Dockerfile").write_text(
        "ARG BASE\nFROM ${BASE}\n"
        "RUN mkdir -p /ws/install/python/robot_msgs && echo WORD=7 > /ws/install/python/robot_msgs/__init__.py && "
        "echo 'export PYTHONPATH=\"/ws/install/python:$PYTHONPATH\"' > /ws/install/setup.bash\n",
        encoding="utf-8",
    )
    base = "BASE=localhost/robot-offload/wheels-ros-core:jazzy"
    machine.run("buildah", "build", "--layers", "--build-arg", base, "--tag", theirs, str(context))
    options = ("--agent", "--from", theirs, "--setup", "ws/install/setup.bash", "--agent-image", named("agent"))
    machine.run(*images_machine.robot_offload("build", "--builder", "buildah", "--tag", both, *options))
    question = (
        "import json, robot_msgs, robot_offload_agent, zenoh; print(json.dumps([robot_msgs.WORD, zenoh.__name__]))"
    )
    with machine.running(both, "sleep", "60") as container:
        asked = container.run("/opt/robot_offload/start", "python3", "-c", question)
        assert json.loads(asked.stdout or "null") == [7, "zenoh"], asked.stderr
        assert container.run("/opt/robot_offload/start", "robot-offload-agent", "--help").returncode == 0
        assert is_not_root(container)
