"""The programs of the test cluster: built once from the Go modules pinned in binaries/, kept outside the checkout."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from robot_offload_lab.cluster.errors import ClusterError, NoGoError

MODULE = Path(__file__).with_name("binaries")
POD_MODULE = Path(__file__).with_name("pods")
"""A separate module: CoreDNS needs other versions of Kubernetes's libraries."""
REGISTRY_MODULE = Path(__file__).with_name("registry")
"""Built only if a cluster needs a registry beside it."""

CONTROL_PLANE: Mapping[str, str] = {
    "etcd": "go.etcd.io/etcd/server/v3",
    "kube-apiserver": "k8s.io/kubernetes/cmd/kube-apiserver",
    "kube-controller-manager": "k8s.io/kubernetes/cmd/kube-controller-manager",
    "kubectl": "k8s.io/kubernetes/cmd/kubectl",
    "helm": "helm.sh/helm/v3/cmd/helm",
}
"""Name of the program -> Go package. Enough for the tests that need no node."""

NODES: Mapping[str, str] = {
    name: f"k8s.io/kubernetes/cmd/{name}" for name in ("kube-scheduler", "kubelet", "kube-proxy")
}
"""What a cluster with nodes needs in addition."""

PODS: Mapping[str, str] = {name: f"./{name}" for name in ("coredns", "pause", "tester")}
"""What runs in pods: of the module in pods/."""

REGISTRY: Mapping[str, str] = {"registry": "./registry"}
"""A container registry: of the module in registry/."""

PROMETHEUS_MODULE = Path(__file__).with_name("prometheus")
PROMETHEUS: Mapping[str, str] = {
    name: f"github.com/prometheus/prometheus/cmd/{name}" for name in ("prometheus", "promtool")
}
"""Reads metrics and evaluates rules, of the module in prometheus/: for the tests of dashboards and alerts."""
TAGS: Mapping[Path, str] = {PROMETHEUS_MODULE: "remove_all_sd"}
"""Build tags by module. Prometheus without service discoveries: a dependency of one is no longer available."""

KIND_MODULE = Path(__file__).with_name("kind")
KIND: Mapping[str, str] = {"kind": "sigs.k8s.io/kind"}
"""For clusters whose nodes are containers of Docker: of the module in kind/."""

KUBEADM_MODULE = Path(__file__).with_name("kubeadm")
KUBEADM: Mapping[str, str] = {"kubeadm": "k8s.io/kubernetes/cmd/kubeadm"}
"""For the image of such a node without access to a registry: of the module in kubeadm/, else as in binaries/."""

REPORT_EVERY = 20.0  # seconds between two lines about a build in progress

Say = Callable[[str], object]


@dataclass(frozen=True, slots=True)
class Programs:
    """A directory that holds every requested program."""

    directory: Path

    def path(self, name: str) -> Path:
        """Return where a program is."""
        return self.directory / name


def cache() -> Path:
    """Return where built programs are kept; shared by all checkouts of this user."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "robot-offload" / "cluster"


def ensure(say: Say, wanted: Mapping[str, str] = CONTROL_PLANE, module: Path = MODULE) -> Programs:
    """Return the programs, building those that are missing.

    Args:
        say: Receives one line of progress at a time.
        wanted: Program names and their Go packages.
        module: Directory of the Go module that pins them.

    Raises:
        NoGoError: Something must be built and Go is not installed.
        ClusterError: The build failed.
    """
    found = _find(wanted, module)
    if found is not None:
        return found
    if shutil.which("go") is None:
        raise NoGoError(
            "The test cluster must be built once and Go is not installed. "
            "Install Go 1.24 or newer (https://go.dev/dl), then: python -m robot_offload_lab.cluster build"
        )
    home = cache() / _key(_go_version(), module)
    with _only_one_builds(say):
        home.mkdir(parents=True, exist_ok=True)
        missing = {name: package for name, package in wanted.items() if not (home / name).exists()}
        if missing:
            _build(missing, module, home, say)
    return Programs(home)


def everything(say: Say) -> tuple[Programs, Programs]:
    """Return the programs of a cluster with nodes, and those that run in its pods."""
    return ensure(say, {**CONTROL_PLANE, **NODES}), ensure(say, PODS, POD_MODULE)


def built() -> bool:
    """Return whether everything that a cluster with nodes needs is built."""
    return bool(_find({**CONTROL_PLANE, **NODES}, MODULE) and _find(PODS, POD_MODULE))


def _find(wanted: Mapping[str, str], module: Path) -> Programs | None:
    """Return the newest complete set for these pins, built by the installed Go version, or by any if Go is missing."""
    version = _go_version() if shutil.which("go") else "*"
    complete = [home for home in cache().glob(_key(version, module)) if all((home / name).exists() for name in wanted)]
    return Programs(max(complete, key=lambda home: home.stat().st_mtime)) if complete else None


def _key(go_version: str, module: Path = MODULE) -> str:
    pins = hashlib.sha256((module / "go.mod").read_bytes() + (module / "go.sum").read_bytes())
    for source in sorted(module.rglob("*.go")):
        pins.update(source.read_bytes())
    return f"{pins.hexdigest()[:16]}-{go_version}"


def _go_version() -> str:
    answer = subprocess.run(["go", "env", "GOVERSION"], cwd=MODULE, capture_output=True, text=True, check=False)
    if answer.returncode:
        raise ClusterError(f"`go env GOVERSION` failed: {answer.stderr.strip()}")
    return answer.stdout.strip()


@contextmanager
def _only_one_builds(say: Say) -> Iterator[None]:
    """Hold the build lock: a second run waits, then finds everything done."""
    cache().mkdir(parents=True, exist_ok=True)
    with (cache() / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("test cluster: another run is building the programs; waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        for left in cache().glob("partial-*"):  # of a build that was killed; no other process can be building now
            shutil.rmtree(left)
        yield


def _build(missing: Mapping[str, str], module: Path, home: Path, say: Say) -> None:
    say(f"test cluster: building {', '.join(missing)} from Go modules; once, some ten minutes on two cores")
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="partial-", dir=cache()) as scratch:
        _run_go(missing, module, Path(scratch), say)
        for name, package in missing.items():
            # os.replace on one file system is atomic: a program that exists is complete.
            (Path(scratch) / _output_name(package)).replace(home / name)
    say(f"test cluster: built in {_minutes(time.monotonic() - begun)}, kept in {home}")


def _run_go(missing: Mapping[str, str], module: Path, target: Path, say: Say) -> None:
    """Compile and link; `go build -v` prints one line for each package that it compiles."""
    command = ["nice", "-n", "5", "go", "build", "-v", "-p", str(os.cpu_count() or 1)]
    command += [
        "-ldflags",
        _link_flags() if module in (MODULE, KUBEADM_MODULE) else "-s -w",
        "-tags",
        TAGS.get(module, ""),
        "-o",
        f"{target}/",
        *missing.values(),
    ]
    flags = "-mod=readonly -trimpath -buildvcs=false"
    environment = {**os.environ, "CGO_ENABLED": "0", "GOFLAGS": flags, "GOWORK": "off"}
    begun = said = time.monotonic()
    compiled, words = 0, ""
    with subprocess.Popen(command, cwd=module, env=environment, stderr=subprocess.PIPE, text=True) as build:
        assert build.stderr is not None
        for line in build.stderr:
            if re.fullmatch(r"[\w./-]+\n", line):
                compiled += 1
            elif not line.startswith("go: downloading"):
                words += line
            if time.monotonic() - said > REPORT_EVERY:
                said = time.monotonic()
                say(f"test cluster: {compiled} packages compiled after {_minutes(said - begun)}")
    if build.returncode:
        raise ClusterError(f"The build failed (Go modules of {module}):\n{words[-3000:]}")


def _link_flags() -> str:
    """Return flags with the versions that programs report; kubectl, helm and the API server compare them."""
    kubernetes, helm = _pinned("k8s.io/kubernetes"), _pinned("helm.sh/helm/v3")
    major, minor, _ = kubernetes.removeprefix("v").split(".")
    component = "k8s.io/component-base/version"
    values = {
        f"{component}.gitVersion": kubernetes,
        f"{component}.gitMajor": major,
        f"{component}.gitMinor": minor,
        f"{component}.gitTreeState": "clean",
        "helm.sh/helm/v3/internal/version.version": helm,
        "helm.sh/helm/v3/pkg/chartutil.k8sVersionMajor": major,
        "helm.sh/helm/v3/pkg/chartutil.k8sVersionMinor": minor,
        "helm.sh/helm/v3/pkg/lint/rules.k8sVersionMajor": major,
        "helm.sh/helm/v3/pkg/lint/rules.k8sVersionMinor": minor,
    }
    return " ".join(["-s", "-w", *(f"-X {name}={value}" for name, value in values.items())])


def _pinned(module: str) -> str:
    found = re.search(rf"^\t{re.escape(module)} (v\S+)", (MODULE / "go.mod").read_text(), re.MULTILINE)
    if found is None:
        raise ClusterError(f"{MODULE}/go.mod does not require {module}")
    return found[1]


def _output_name(package: str) -> str:
    """Return the file name that Go gives to a package's program: its last part that is not a version."""
    parts = package.split("/")
    return parts[-2] if re.fullmatch(r"v\d+", parts[-1]) else parts[-1]


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60} min {int(seconds) % 60} s"
