"""One story: a namespace of the cluster, what is applied there, and what is kept when it goes wrong."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import yaml

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.errors import CommandError
from robot_offload_lab.cluster.robot_host import RobotHost
from tests.e2e.figures import tell
from tests.e2e.images import APP, Images
from tests.e2e.robot import Robot
from tests.e2e.waiting import PATIENCE_S, eventually

ROOT: Final = Path(__file__).parents[2]
SAMPLES: Final = ROOT / "manifests" / "samples"
RESTRICTED: Final = {"pod-security.kubernetes.io/enforce": "restricted"}
"""The strictest level of Kubernetes: a namespace in which our pods must be able to run."""
READY: Final = (
    "SpecValid", "ResourcesApplied", "DiscoveryReady", "WorkloadsAvailable", "CertificatesReady",
    "AddressesReady",
)  # fmt: skip
"""The conditions that are true as soon as the cloud's side stands, with no robot yet."""
CONNECTED: Final = (*READY, "Connected", "ConfigCurrent", "Ready")

Manifest = dict[str, Any]


@dataclass
class Story:
    """A namespace of its own, and the robots of the story.

    Attributes:
        cluster: on which it plays.
        images: what its pods are made of.
        namespace: its own.
        folder: for everything that stays: logs, recordings, what went wrong.
    """

    cluster: AnyCluster
    images: Images
    namespace: str
    folder: Path
    robots: dict[str, Robot] = field(default_factory=dict)
    _stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> Self:
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        labels = {"kind": "Namespace", "apiVersion": "v1", "metadata": {"name": self.namespace, "labels": RESTRICTED}}
        self.cluster.kubectl("").apply(labels)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is not None:
                self.tell_everything()
        finally:
            self._stack.close()
            # Nobody waits for its end: the next story has a namespace of its own.
            self.cluster.kubectl("")("delete", "namespace", self.namespace, "--wait=false", "--ignore-not-found")

    # -- the cluster --------------------------------------------------------------------------------------------------

    @property
    def kubectl(self) -> Kubectl:
        """kubectl in the story's namespace."""
        return self.cluster.kubectl(self.namespace)

    def offload_command(self, *arguments: str, patience_s: float = 180.0) -> str:
        """`kubectl offload ...` as a user types it: the plugin, found through the search path.

        Raises:
            CommandError: it failed.
        """
        plugins = Path(sys.executable).parent
        command = (str(self.kubectl.program), "offload", *arguments, "--namespace", self.namespace)
        environment = {
            "PATH": f"{plugins}:{os.environ['PATH']}",
            "HOME": str(self.folder),
            "KUBECONFIG": str(self.cluster.kubeconfig),
        }
        done = subprocess.run(
            command, env=environment, cwd=self.folder, capture_output=True, text=True, timeout=patience_s, check=False
        )
        if done.returncode:
            raise CommandError(f"kubectl offload {' '.join(arguments)}: {done.stdout}{done.stderr}".strip())
        return done.stdout

    def sample(self, name: str, change: Callable[[Manifest], None] | None = None) -> Manifest:
        """A sample of the repository with the images of this cluster.

        Args:
            name: of its file in manifests/samples, without `.yaml`.
            change: is given the whole manifest to change it in place.
        """
        manifest: Manifest = yaml.safe_load((SAMPLES / f"{name}.yaml").read_text(encoding="utf-8"))
        for node in manifest["spec"]["nodes"]:
            if "image" in node:
                node["image"] = self.images.references[APP]
        if change:
            change(manifest)
        return manifest

    def apply(self, manifest: Mapping[str, Any]) -> RobotOffload:
        """Applies a RobotOffload, as `kubectl apply` does; returns it as the product reads it."""
        self.kubectl.apply(manifest, options=())
        return parse_object(deepcopy(dict(manifest)), str(manifest["metadata"]["name"]))

    def resource(self, name: str) -> Manifest:
        """The RobotOffload as it is stored."""
        found: Manifest = self.kubectl.json("get", "robotoffload", name)
        return found

    def conditions(self, name: str) -> dict[str, Manifest]:
        """Its conditions by type, those of the present generation only."""
        resource = self.resource(name)
        generation = resource["metadata"]["generation"]
        conditions = (resource.get("status") or {}).get("conditions") or []
        return {each["type"]: each for each in conditions if each["observedGeneration"] == generation}

    def wait_conditions(self, name: str, *types: str, patience_s: float = PATIENCE_S) -> None:
        """Waits until all these conditions are true; their reasons are told when they do not come."""

        def all_true() -> bool:
            there = self.conditions(name)
            return all(there.get(one, {}).get("status") == "True" for one in types)

        def instead() -> str:
            there = self.conditions(name)
            return "; ".join(
                f"{one}={there[one]['status']} {there[one].get('reason')}: {there[one].get('message')}"
                if one in there
                else f"no {one}"
                for one in types
                if there.get(one, {}).get("status") != "True"
            )

        eventually(all_true, f"{', '.join(types)} of {name}", patience_s=patience_s, instead=instead)

    def pods(self, name: str, component: str = "") -> list[Manifest]:
        """The pods of a RobotOffload that are not on their way out."""
        selector = f"app.kubernetes.io/instance={name}"
        selector += f",app.kubernetes.io/component={component}" if component else ""
        items = self.kubectl.json("get", "pods", "-l", selector)["items"]
        return [pod for pod in items if "deletionTimestamp" not in pod["metadata"]]

    def placement(self, name: str) -> str:
        """The placement in the status."""
        return str((self.resource(name).get("status") or {}).get("placement", ""))

    # -- robots -------------------------------------------------------------------------------------------------------

    def bundle(self, name: str) -> Path:
        """Writes the robot's folder with `kubectl offload bundle`, and nothing else."""
        folder = self.folder / f"bundle-{name}"
        self.offload_command("bundle", name, "-o", str(folder))
        return folder

    def host(self, name: str, *, neighbour: bool = False) -> RobotHost:
        """A machine outside the cluster that goes with the story.

        Args:
            name: of the RobotOffload that it will be a robot of.
            neighbour: without NAT and with routes to the pods, as in a VPN.
        """
        make = self.cluster.neighbour if neighbour else self.cluster.robot
        host = make(f"{name[:14]}-{len(self.robots) + 1}")
        self._stack.callback(host.remove)
        return host

    def robot(
        self, offload: RobotOffload, *, neighbour: bool = False, host: RobotHost | None = None, example: str = ""
    ) -> Robot:
        """A robot outside the cluster with the bundle of this resource; nothing runs on it yet.

        Args:
            offload: what it is a robot of.
            neighbour: without NAT and with routes to the pods, as in a VPN.
            host: one that is there already, because its address had to be known; None: a new one.
            example: whose nodes share processes and need interface packages of their own; see `Robot`.
        """
        name = offload.metadata.name
        machine = host or self.host(name, neighbour=neighbour)
        robot = Robot(machine, offload, self.bundle(name), self.folder / name, example)
        self._stack.callback(robot.stop)
        self.robots[name] = robot
        return robot

    # -- when it goes wrong -------------------------------------------------------------------------------------------

    def tell_everything(self) -> None:
        """Writes what a person would look at into the story's folder."""
        kubectl, folder = self.kubectl, self.folder
        with suppress(Exception):
            names = [each.partition("/")[2] for each in kubectl.names("robotoffloads")]
            for name in names:
                self._keep(f"explain-{name}.txt", partial(self.offload_command, "explain", name))
        self._keep("describe.txt", lambda: kubectl("describe", "robotoffloads,pods,services,endpointslices"))
        self._keep("events.txt", lambda: kubectl("get", "events", "--sort-by=.lastTimestamp"))
        self._keep("nodes.txt", lambda: kubectl.within("")("describe", "nodes"))
        operator = kubectl.within("robot-offload-system")
        self._keep("operator.log", lambda: operator("logs", "deployment/robot-offload-operator", "--tail=2000"))
        with suppress(Exception):
            for pod in kubectl.names("pods"):
                short = pod.partition("/")[2]
                for kind, option in (("", ()), ("-before", ("--previous",))):
                    arguments = ("logs", pod, "--all-containers", "--prefix", "--tail=2000", *option)
                    self._keep(f"pod-{short}{kind}.log", partial(kubectl, *arguments))
        tell(f"what was found is in {folder}")

    def _keep(self, file: str, look: Callable[[], str]) -> None:
        try:
            text = look()
        except (CommandError, subprocess.TimeoutExpired, OSError) as error:
            text = f"not to be had: {error}\n"
        (self.folder / file).write_text(text, encoding="utf-8")


def state_of_pods(story: Story, name: str) -> str:
    """One line per pod, for messages."""
    lines = []
    for pod in story.pods(name):
        waiting = [
            f"{one['name']}: {json.dumps(one.get('state', {}))}"
            for one in pod["status"].get("containerStatuses", [])
            if not one.get("ready")
        ]
        lines.append(f"{pod['metadata']['name']} {pod['status']['phase']} {' '.join(waiting)}")
    return "\n".join(lines)
