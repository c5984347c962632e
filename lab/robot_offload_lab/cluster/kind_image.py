"""An image for the nodes of kind, built here: for machines without access to a container registry.

`python -m robot_offload_lab.cluster.kind_image` makes it, unless Docker has it, and prints its name for
ROBOT_OFFLOAD_KIND_IMAGE.

It is Debian with what the Dockerfile of kind's own image installs, kind's own files, our Kubernetes, and the images
that kubeadm asks for, each of one program of ours. Two things differ from kind's image: containerd and runc are
Debian's, with a runc that also works where root lacks CAP_SYS_RESOURCE; and the network between pods has no daemon
(kindnetd), so that it does not enforce NetworkPolicies.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from robot_offload_lab.cluster import kind_docker, oci, programs
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.programs import Programs, Say

PACKAGES: Final = (
    *("systemd", "systemd-sysv", "dbus", "kmod", "util-linux", "mount", "procps", "hostname", "bash", "jq"),
    *("containerd", "runc", "containernetworking-plugins", "ca-certificates", "curl"),
    *("conntrack", "iptables", "nftables", "iproute2", "ethtool", "socat"),
)
SUITE: Final = "bookworm"
REPOSITORY: Final = "localhost/rofkind-node"
HERE: Final = Path(__file__).parent
_NETWORK: Final = HERE / "kind_image_network.sh"
_RUNC: Final = HERE / "kind_runc.sh"
_CARRIED_OUT: Final = 1200.0  # seconds for the longest step: Debian's packages
_UNWANTED: Final = (
    *("lib/systemd/system/multi-user.target.wants/*", "etc/systemd/system/*.wants/*"),
    *("lib/systemd/system/local-fs.target.wants/*", "lib/systemd/system/basic.target.wants/*"),
    *("lib/systemd/system/sockets.target.wants/*udev*", "lib/systemd/system/sockets.target.wants/*initctl*"),
    "lib/systemd/system/sysinit.target.wants/systemd-tmpfiles-setup.service",
    *("var/cache/apt/*", "var/lib/apt/lists/*", "usr/share/doc/*", "usr/share/man/*", "usr/share/locale/*"),
)
"""Services that kind's Dockerfile removes, and files that only take space."""
_SERVICES: Final = ("kubelet", "containerd", "undo-mount-hacks", "rofkind-network")
_UNIT: Final = """[Unit]
After=network.target
[Service]
Type=simple
ExecStart=/kind/bin/network.sh
[Install]
WantedBy=multi-user.target
"""
_NO_DAEMON: Final = {
    "apiVersion": "v1",
    "kind": "ConfigMap",
    "metadata": {"name": "rofkind", "namespace": "kube-system"},
}
"""Something harmless to apply in place of kind's network daemon."""
_STORAGE: Final = {
    "apiVersion": "storage.k8s.io/v1",
    "kind": "StorageClass",
    "metadata": {"name": "standard"},
    "provisioner": "kubernetes.io/no-provisioner",
}
"""Kind applies a storage manifest; clusters for our stories need no storage."""


def provide(say: Say) -> str:
    """Return the name of the image; make it if Docker does not have it.

    Raises:
        ClusterError: The image cannot be made here.
    """
    if why := kind_docker.silent() or _missing():
        raise ClusterError(f"No image of a node can be made: {why}")
    servers, inside = programs.everything(say)
    kubeadm = programs.ensure(say, programs.KUBEADM, programs.KUBEADM_MODULE)
    source = kind_source()
    name = f"{REPOSITORY}:{_key(servers, inside, kubeadm, source)}"
    if kind_docker.run("images", "--quiet", name).strip():
        return name
    say(f"kind: making an image for nodes, {name}; once, some minutes")
    with tempfile.TemporaryDirectory(prefix="rofkind-node-", dir="/var/tmp") as scratch:
        root = Path(scratch) / "root"
        _debian(root)
        _furnish(root, source, servers, kubeadm)
        archives = _images(root, Path(scratch), servers, inside, kubeadm)
        base = _import(root)
        say("kind: putting the images of the control plane into it")
        _carry(base, archives, name)
    return name


def kind_source() -> Path:
    """Return the source of the pinned kind, from the cache of Go."""
    command = ["go", "mod", "download", "-json", "sigs.k8s.io/kind"]
    done = subprocess.run(command, cwd=programs.KIND_MODULE, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ClusterError(f"{' '.join(command)}: {done.stderr.strip() or done.stdout.strip()}")
    return Path(json.loads(done.stdout)["Dir"])


def _missing() -> str:
    absent = [each for each in ("debootstrap", "go") if shutil.which(each) is None]
    return f"these commands are missing: {', '.join(absent)}" if absent else ""


def _key(*parts: Programs | Path) -> str:
    """Return a name for the image's parts: programs and sources are named by their versions."""
    digest = hashlib.sha256(" ".join(str(each) for each in parts).encode())
    for path in (Path(__file__), _NETWORK, _RUNC):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


# -- what is on its disk ----------------------------------------------------------------------------------------------


def _debian(root: Path) -> None:
    _run("debootstrap", "--variant=minbase", f"--include={','.join(PACKAGES)}", SUITE, str(root))


def _furnish(root: Path, source: Path, servers: Programs, kubeadm: Programs) -> None:
    """Do what the Dockerfile of kind's base image and kind's build of a node's image do."""
    _copy_files(source / "images" / "base" / "files", root)
    for pattern in _UNWANTED:
        for path in root.glob(pattern):
            _remove(path)
    with (root / "etc/systemd/journald.conf").open("a") as text:
        text.write("ReadKMsg=no\n")
    units = root / "etc/systemd/system"
    (units / "rofkind-network.service").write_text(_UNIT)
    (units / "multi-user.target.wants").mkdir(exist_ok=True)
    for name in _SERVICES:
        (units / "multi-user.target.wants" / f"{name}.service").symlink_to(f"/etc/systemd/system/{name}.service")
    (units / "systemd-binfmt.service").symlink_to("/dev/null")
    for folder in ("etc/kubernetes/manifests", "kind/manifests", "opt/cni/bin"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    (root / "kind/manifests/default-cni.yaml").write_text(json.dumps(_NO_DAEMON))
    (root / "kind/manifests/default-storage.yaml").write_text(json.dumps(_STORAGE))
    (root / "kind/version").write_text(_version(kubeadm))
    for program in (servers.path("kubelet"), servers.path("kubectl"), kubeadm.path("kubeadm")):
        _install(program, root / "usr/bin" / program.name)
    _install(_NETWORK, root / "kind/bin/network.sh")
    _install(_RUNC, root / "usr/local/sbin/runc")
    for name in ("containerd", "ctr", "containerd-shim-runc-v2"):  # kind's files name them where kind builds them
        (root / "usr/local/bin" / name).symlink_to(f"/usr/bin/{name}")
    for plugin in (root / "usr/lib/cni").iterdir():
        _install(plugin, root / "opt/cni/bin" / plugin.name)
    _containers(root)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _copy_files(files: Path, root: Path) -> None:
    """Copy files as the Dockerfile does: programs are executable, everything is read-only."""
    for path in sorted(each for each in files.rglob("*") if each.is_file()):
        place = path.relative_to(files)
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, root / place)
        (root / place).chmod(0o755 if "bin" in place.parts else 0o644)


def _containers(root: Path) -> None:
    """Write containerd's settings: kind's, with the hook of its Dockerfile, and for a root with fewer rights."""
    specification = json.loads(_run("chroot", str(root), "ctr", "oci", "spec"))
    specification["hooks"] = {"createContainer": [{"path": "/kind/bin/mount-product-files.sh"}]}
    del specification["process"]["rlimits"]
    (root / "etc/containerd/cri-base.json").write_text(json.dumps(specification))
    settings = root / "etc/containerd/config.toml"
    careful = settings.read_text().replace("restrict_oom_score_adj = false", "restrict_oom_score_adj = true")
    settings.write_text(careful)


def _install(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)
    target.chmod(0o755)


def _version(kubeadm: Programs) -> str:
    return _run(str(kubeadm.path("kubeadm")), "version", "--output", "short").strip()


# -- the images in it -------------------------------------------------------------------------------------------------


def _images(root: Path, folder: Path, servers: Programs, inside: Programs, kubeadm: Programs) -> list[Path]:
    """Return archives of all images that kubeadm asks for, under the names that it uses."""
    command = (str(kubeadm.path("kubeadm")), "config", "images", "list", "--kubernetes-version", _version(kubeadm))
    wanted = _run(*command).split()
    sandbox = re.search(r'sandbox_image\s*=\s*"(.+)"', (root / "etc/containerd/config.toml").read_text())
    assert sandbox is not None, "kind's settings of containerd name no pause image"
    archives: list[Path] = []
    for name in dict.fromkeys([*wanted, sandbox[1]]):
        short = name.rpartition("/")[2].partition(":")[0]
        archive = folder / f"{len(archives)}-{short}.tar"
        if short in ("coredns", "pause"):
            oci.write(archive, name, inside.path(short), user="0:0")
        else:
            # Pods name them without a folder, so they are put on the search path.
            more = _with_libraries(root, "usr/sbin/nft") if short == "kube-proxy" else {}
            oci.write(archive, name, servers.path(short), folder="usr/local/bin", user="0:0", more=more)
        archives.append(archive)
    return archives


def _with_libraries(root: Path, program: str) -> Mapping[str, Path]:
    """Return a program of Debian and the libraries that it loads."""
    found = re.findall(r"(/\S+) \(0x", _run("chroot", str(root), "ldd", f"/{program}"))
    return {place: root / place for place in (program, *(each.lstrip("/") for each in found))}


# -- in Docker --------------------------------------------------------------------------------------------------------


def _import(root: Path) -> str:
    """Build an image of these files; return its name."""
    changes = ("ENV container=docker", 'ENTRYPOINT ["/usr/local/bin/entrypoint", "/sbin/init"]')
    options = [word for change in changes for word in ("--change", change)]
    with subprocess.Popen(["tar", "-C", str(root), "--numeric-owner", "-c", "."], stdout=subprocess.PIPE) as packing:
        found = kind_docker.run("import", *options, "-", stdin=packing.stdout, limit=_CARRIED_OUT)
    return found.strip()


def _carry(base: str, archives: list[Path], name: str) -> None:
    """Have the containerd of the image import the archives, and keep the result under a name."""
    with _started(base) as container:
        for archive in archives:
            with archive.open("rb") as content:
                take = ("ctr", "--namespace=k8s.io", "images", "import", "--all-platforms", "--no-unpack", "--digests")
                kind_docker.run("exec", "--interactive", container, *take, "-", stdin=content)
        kind_docker.inside(container, "pkill", "containerd")
        entrypoint = 'ENTRYPOINT ["/usr/local/bin/entrypoint", "/sbin/init"]'
        changes = ("--change", entrypoint, "--change", "CMD []")
        kind_docker.run("commit", *changes, container, name, limit=_CARRIED_OUT)


@contextmanager
def _started(image: str) -> Iterator[str]:
    """Yield the name of a container in which only containerd runs."""
    script = "mkdir -p /run/containerd && containerd > /run/containerd.log 2>&1 & sleep infinity"
    name = "rofkind-making"
    kind_docker.run("run", "--detach", "--privileged", "--name", name, "--entrypoint", "sh", image, "-c", script)
    try:
        wait = "for n in $(seq 100); do ctr version > /dev/null 2>&1 && exit; sleep 0.1; done; exit 1"
        kind_docker.inside(name, "sh", "-c", wait)
        yield name
    finally:
        kind_docker.run("rm", "--force", "--volumes", name)


def _run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=_CARRIED_OUT, check=False)
    if done.returncode:
        raise ClusterError(f"{' '.join(command)}: {(done.stderr.strip() or done.stdout.strip())[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    print(provide(lambda line: print(line, file=sys.stderr, flush=True)))  # noqa: T201 - a command line prints
