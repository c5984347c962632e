"""What a build in the cluster needs around it: a registry, a private repository, buildah's image, a base image."""

from __future__ import annotations

import fcntl
import hashlib
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload.images.builders import Request, run
from robot_offload_lab.cluster import programs
from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.image_registry import ImageRegistry
from robot_offload_lab.images import ours, wheels_base
from robot_offload_lab.images.ours import ROOT
from robot_offload_lab.images.wheels_base import Stage
from tests.e2e.figures import tell
from tests.e2e.images import REPOSITORY, builder_environment, cache_folder
from tests.integration.test_images_build import commit, git, write_source
from tests.integration.test_images_private import TOKEN, certify, serving

CONTEXT: Final = ROOT / "tests" / "e2e" / "builder"
BUILT: Final = "robots"
"""The folder of the registry that the cluster pushes to."""
BROKEN: Final = "Package talker has no executable talker. It has:"
"""What is wrong with the other branch."""
_WANTED: Final[tuple[tuple[str, str, Stage], ...]] = (
    ("builder", "builder", "ros-core"),
    ("git", "git", "ros-core"),
    ("base", "base", "ros-base"),
    ("runtime", "base", "ros-core"),
)
"""Image, stage of the Dockerfile, and what of ROS it starts from."""
_PUSH_LIMIT_S: Final = 600.0


@dataclass(frozen=True, slots=True)
class Workshop:
    """The places that a RobotOffload with a `build:` block names.

    Attributes:
        registry: beside the cluster.
        url: of the repository; it asks for a password.
        commits: by branch: `main` is good, `broken` cannot be built.
        builder: the image with buildah.
        git: the image with git: ours, and it trusts the repository's server.
        base: the image to build in.
        runtime: the image to run in.
    """

    registry: ImageRegistry
    url: str
    commits: dict[str, str]
    builder: str
    git: str
    base: str
    runtime: str

    @property
    def login(self) -> dict[str, str]:
        """Of a Secret of type kubernetes.io/basic-auth."""
        return {"username": "robot", "password": TOKEN}


@contextmanager
def workshop(cluster: AnyCluster, folder: Path) -> Iterator[Workshop]:
    """All of it for one cluster, as long as the block runs.

    Args:
        cluster: from whose nodes and pods it is reached.
        folder: for the repository.
    """
    program = programs.ensure(tell, programs.REGISTRY, programs.REGISTRY_MODULE).path("registry")
    address = cluster.layout.host
    kept = cache_folder() / "builds" / address
    kept.mkdir(parents=True, exist_ok=True)
    # Base and builder stay and are compressed once; what a cluster has pushed goes, or nothing would be built.
    shutil.rmtree(kept / "registry/docker/registry/v2/repositories" / BUILT, ignore_errors=True)
    if not (kept / "certificate.pem").exists():
        certify(kept, address, days=3650)  # of the same content the base has the same layers
    (folder / "robot.git").mkdir(parents=True)
    commits = _source(folder / "robot.git")
    registry = ImageRegistry(cluster.layout, program, kept / "registry")
    with registry, serving(folder, kept, address) as url:
        with (cache_folder() / "lock").open("w") as gate:
            fcntl.flock(gate, fcntl.LOCK_EX)  # the store is shared with the images of all stories
            builder, fetcher, base, runtime = _images(registry, kept / "certificate.pem")
        yield Workshop(registry, f"{url}/robot.git", commits, builder, fetcher, base, runtime)


def _source(folder: Path) -> dict[str, str]:
    """A repository with a branch that can be built and one that cannot; their commits."""
    write_source(folder)
    git(folder, "init", "--quiet", "--initial-branch=main")
    commits = {"main": commit(folder)}
    git(folder, "checkout", "--quiet", "-b", "broken")
    setup = folder / "src/talker/setup.py"
    setup.write_text(setup.read_text().replace("talker = talker.node", "tolker = talker.node"))
    return commits | {"broken": commit(folder)}


def _images(registry: ImageRegistry, certificate: Path) -> tuple[str, ...]:
    """Names of builder, git, base and runtime base in the registry; built and pushed where they are not there yet."""
    environment = builder_environment(cache_folder())
    wheels_base.build("buildah", ROOT, wheels_base.lent("buildah"), environment=environment)
    own = next(image for image in ours.OURS if image.name == "git")
    settings = ours.BuildSettings(REPOSITORY, "builds", "builds", extra=wheels_base.lent("buildah"))
    fetcher = ours.request(own, settings, wheels_base.tag("system"))
    run("buildah", fetcher, environment=environment)
    names = []
    with tempfile.TemporaryDirectory(prefix="robot-offload-builder-") as scratch:
        context = Path(shutil.copytree(CONTEXT, scratch, dirs_exist_ok=True))
        shutil.copy2(certificate, context)
        key = _key(context)
        for image, target, ros in _WANTED:
            name = f"{registry.address}/ours/{image}:{key}"
            names.append(name)
            if registry.has(f"ours/{image}", key):
                continue
            wanted = Request(
                tag=name,
                context=context,
                dockerfile=str(context / "Dockerfile"),
                build_arguments={
                    "SYSTEM": wheels_base.tag("system"),
                    "ROS": wheels_base.tag(ros),
                    "GIT": fetcher.tag,
                },
                # Nothing of the machine is lent: its certificates would lie over those of the image.
                extra=("--target", target, "--isolation", "chroot"),
            )
            run("buildah", wanted, environment=environment)
            command = ("buildah", "push", "--quiet", "--tls-verify=false", name)
            subprocess.run(command, check=True, timeout=_PUSH_LIMIT_S, env=environment)
    return tuple(names)


def _key(context: Path) -> str:
    """A name for what these images are made of."""
    made_of = (*sorted(context.iterdir()), ROOT / "images" / "git" / "Dockerfile")
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in made_of))
    archives = wheels_base.archives(wheels_base.cache_folder())
    digest.update(wheels_base.fingerprint(ROOT / "images" / "wheels-base", archives).encode())
    return digest.hexdigest()[:12]
