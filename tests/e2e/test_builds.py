"""A node whose image the cluster builds: from a private repository to a pod that runs the digest that was pushed."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from robot_offload_lab.cluster.errors import CommandError
from tests.e2e.builds_parts import BROKEN, BUILT, Workshop, workshop
from tests.e2e.chart import Chart
from tests.e2e.figures import figure
from tests.e2e.story import READY, Manifest, Story, state_of_pods
from tests.e2e.waiting import eventually

BUILD_S = 900.0
pytestmark = pytest.mark.timeout(2400)  # the first time, builder and base are built as well


@pytest.fixture
def place(story: Story, chart: Chart) -> Iterator[Workshop]:
    """What the build needs; the chart's values are its defaults, and are so again afterwards."""
    with workshop(story.cluster, story.folder / "source") as found:
        # Builds need more than the restricted level: docs/how-to/images.md, "In the cluster".
        label = "pod-security.kubernetes.io/enforce=privileged"
        story.kubectl.within("")("label", "namespace", story.namespace, label, "--overwrite")
        yield found
        chart.rollback()


def talker(story: Story, place: Workshop, branch: str) -> Manifest:
    """The smallest sample with the source of its node instead of an image."""

    def change(manifest: Manifest) -> None:
        manifest["spec"]["cloud"] = {"registry": {"repository": f"{place.registry.address}/{BUILT}", "insecure": True}}
        node = manifest["spec"]["nodes"][0]
        del node["image"]
        node["run"] = {"package": "talker", "executable": "talker"}
        node["build"] = {
            "git": {"url": place.url, "ref": branch, "paths": ["src/talker"]},
            "gitSecret": {"name": "git-reader"},
            "package": "talker",
            "executable": "talker",
            "base": place.base,
            "runtimeBase": place.runtime,
        }

    return story.sample("talker", change)


def allow_builds(story: Story, chart: Chart, place: Workshop) -> None:
    """Does what the how-to says: builds are off until an administrator sets the chart's value."""
    wanted = talker(story, place, "main")
    assert "builds.enabled" in story.kubectl.apply_refused(wanted)
    chart.upgrade(images__builder=place.builder, images__git=place.git, builds__enabled=True)

    def allowed() -> bool:  # a changed admission policy counts after a moment
        try:
            story.kubectl.apply(wanted, options=("--dry-run=server",))
        except CommandError:
            return False
        return True

    eventually(allowed, "the admission policy that allows builds")


def test_source_becomes_a_running_pod_and_a_broken_source_is_told_by_its_line(
    story: Story, chart: Chart, place: Workshop
) -> None:
    allow_builds(story, chart, place)
    story.kubectl.apply(
        {
            "apiVersion": "v1",
            "kind": "Secret",
            "metadata": {"name": "git-reader"},
            "type": "kubernetes.io/basic-auth",
            "stringData": place.login,
        }
    )
    applied_s = time.monotonic()
    story.apply(talker(story, place, "main"))
    built(story)
    figure("apply to image in the registry", time.monotonic() - applied_s, "s")
    story.wait_conditions("talker", *READY, patience_s=300)
    figure("apply to the pod with the built image ready", time.monotonic() - applied_s, "s")

    node = status(story)
    repository, _, digest = str(node["image"]).partition("@")
    assert repository == f"{place.registry.address}/{BUILT}/talker"
    assert place.registry.has(f"{BUILT}/talker", digest)
    assert node["commit"] == place.commits["main"]
    [pod] = story.pods("talker", "node")
    assert pod["spec"]["containers"][0]["image"] == node["image"]
    assert pod["status"]["containerStatuses"][0]["imageID"].endswith(digest)

    story.apply(talker(story, place, "broken"))
    said = eventually(lambda: failure(story), "the failed build", patience_s=BUILD_S)
    assert said["reason"] == "BuildFailed"
    assert BROKEN in said["message"]
    assert status(story)["image"] == node["image"], "the node keeps the image that it has"
    [after] = story.pods("talker", "node")
    assert after["metadata"]["name"] == pod["metadata"]["name"]


def built(story: Story) -> None:
    """Waits for the image; a build that fails is told at once."""

    def ended() -> Manifest:
        there = story.conditions("talker").get("ImageBuilt", {})
        return there if there.get("status") == "True" or there.get("reason") == "BuildFailed" else {}

    found = eventually(ended, "the image", patience_s=BUILD_S, instead=lambda: state_of_pods(story, "talker"))
    assert found["status"] == "True", found["message"]


def failure(story: Story) -> Manifest:
    """The condition ImageBuilt when it is false; empty before."""
    there = story.conditions("talker").get("ImageBuilt", {})
    return there if there.get("status") == "False" else {}


def status(story: Story) -> Manifest:
    """What the status says of the node."""
    nodes: list[Manifest] = story.resource("talker")["status"]["nodes"]
    return next(node for node in nodes if node["name"] == "talker")
