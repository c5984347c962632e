"""The image of a node of kind, made here: Debian's packages, kind's files, our Kubernetes and its images."""

from __future__ import annotations

import shutil
import sys

import pytest

from robot_offload_lab.cluster import kind_docker, kind_image

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(3600)]


@pytest.fixture(scope="module")
def image() -> str:
    if why := kind_docker.silent():
        pytest.skip(f"No image of a node can be made: {why}")
    if shutil.which("debootstrap") is None:
        pytest.skip("No image of a node can be made: there is no debootstrap. Next: apt-get install debootstrap")
    return kind_image.provide(lambda line: sys.stderr.write(f"{line}\n"))


def within(image: str, script: str) -> list[str]:
    """What a shell in a container of the image prints."""
    command = ("run", "--rm", "--privileged", "--entrypoint", "sh", image, "-c", script)
    return kind_docker.run(*command).split()


def test_it_holds_every_image_that_kubeadm_asks_for(image: str) -> None:
    listing = (
        "for n in $(seq 100); do ctr version > /dev/null 2>&1 && break; sleep 0.1; done; ctr -n k8s.io images ls -q"
    )
    there = within(image, f"mkdir -p /run/containerd; containerd > /dev/null 2>&1 & {listing}")
    wanted = within(image, "kubeadm config images list --kubernetes-version $(cat /kind/version)")
    assert len(wanted) >= 7
    assert set(wanted) <= set(there)


def test_kubelet_kubeadm_and_kubectl_are_of_the_version_that_it_says(image: str) -> None:
    [said] = within(image, "cat /kind/version")
    assert within(image, "kubeadm version --output short; kubelet --version")[:3] == [said, "Kubernetes", said]


def test_it_is_made_only_once(image: str) -> None:
    def silent(line: str) -> None:
        pytest.fail(f"nothing is to be made, but: {line}")

    assert kind_image.provide(silent) == image
