"""Nodes that are built in the cluster, under a running operator, a real API server and the real Job controller.

No Pod runs here: what a build would have said comes from the pretended kubelet.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from robot_offload.decide.builds import REBUILD
from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, JOB, ROBOT_OFFLOAD, SECRET
from robot_offload_lab.cluster.pretended_kubelet import report_ended
from tests.integration.operator_cluster import Manifest, Place, eventually, walker
from tests.integration.operator_process import Operator
from tests.integration.operator_proxy import Proxy

pytestmark = pytest.mark.api
COMMIT = "8a5b1c2d3e4f5a6b7c8d9e0f1a2b3c4d5e6f7a8b"
REPOSITORY = "registry.example/fleet"
IMAGE = f"{REPOSITORY}/demo_nodes_cpp@sha256:"


def built(ref: str = "v1", registry: dict[str, Any] | None = None) -> Manifest:
    """A RobotOffload whose node is built."""
    manifest = walker(cloud={"registry": {"repository": REPOSITORY, **(registry or {})}})
    [node] = manifest["spec"]["nodes"]
    del node["image"]
    git = {"url": "https://git.example/robot.git", "ref": ref}
    node["build"] = {"git": git, "package": "demo_nodes_cpp", "executable": "talker"}
    return manifest


def the_job(place: Place) -> str:
    """The name of the one build Job, as soon as its Pod is there."""

    def look() -> str | None:
        jobs = [job["metadata"]["name"] for job in place.list(JOB) if not job["metadata"].get("deletionTimestamp")]
        path = f"/api/v1/namespaces/{place.namespace}/pods?labelSelector=batch.kubernetes.io/job-name="
        return jobs[0] if len(jobs) == 1 and json.loads(place.plane.get(path + jobs[0]))["items"] else None

    found = eventually(look, "one build Job with a Pod", lambda: place.list(JOB))
    assert found is not None
    return found


def succeed(place: Place, job: str, digit: str = "7") -> None:
    """The Pod of the Job ends well."""
    told = json.dumps({"commit": COMMIT, "digest": f"sha256:{digit * 64}"})
    assert report_ended(place.plane, place.namespace, job, {"push": told})


def image(place: Place) -> str:
    deployment = place.get(DEPLOYMENT, "walker-talker")
    return deployment["spec"]["template"]["spec"]["containers"][0]["image"] if deployment else ""


def wait_image(place: Place, digit: str) -> None:
    eventually(lambda: image(place) == IMAGE + digit * 64, "the new image to be rolled out", lambda: image(place))


def test_an_image_is_built_rolled_out_and_told(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, built())
    place.wait_condition("ImageBuilt", "Unknown", "Building")
    assert place.get(DEPLOYMENT, "walker-talker") is None
    assert "not built yet" in place.roff()["status"]["nodes"][0]["message"]
    job = the_job(place)
    succeed(place, job)
    message = place.wait_condition("ImageBuilt", "True", "Built")["message"]
    assert COMMIT[:12] in message
    wait_image(place, "7")
    [node] = eventually(
        lambda: [node for node in place.roff()["status"]["nodes"] if node.get("commit")], "the commit in the status"
    )
    assert (node["image"], node["commit"]) == (IMAGE + "7" * 64, COMMIT)
    eventually(lambda: "ImageBuilt" in {event["reason"] for event in place.events()}, "the event", place.events)


def test_a_built_image_needs_neither_its_job_nor_another_write(place: Place, proxy: Proxy, operator: Operator) -> None:
    place.create(ROBOT_OFFLOAD, built())
    succeed(place, the_job(place))
    wait_image(place, "7")
    # As the time to live of a finished Job does it.
    for job in place.list(JOB):
        place.plane.request(
            "DELETE", f"{JOB.path(place.namespace, job['metadata']['name'])}?propagationPolicy=Background"
        )
    eventually(lambda: not place.list(JOB), "the Job to be gone")
    proxy.quiet(place.namespace)
    count = len(proxy.writes_in(place.namespace))
    operator.restart()
    place.create(ROBOT_OFFLOAD, walker("marker"))
    place.applied("marker")
    proxy.quiet(place.namespace)
    assert [asked for asked in proxy.writes_in(place.namespace)[count:] if "walker" in asked.path] == []
    assert place.list(JOB) == []
    assert image(place) == IMAGE + "7" * 64


def test_a_new_source_is_built_while_the_old_image_runs(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, built())
    first = the_job(place)
    succeed(place, first)
    wait_image(place, "7")
    place.replace_spec(built("v2")["spec"])
    place.gone(JOB, first)
    place.wait_condition("ImageBuilt", "Unknown", "Building")
    assert image(place) == IMAGE + "7" * 64
    succeed(place, the_job(place), "8")
    wait_image(place, "8")


def test_a_failed_build_is_told_with_its_line_kept_and_corrected(place: Place, proxy: Proxy) -> None:
    place.create(ROBOT_OFFLOAD, built())
    succeed(place, the_job(place))
    wait_image(place, "7")
    place.replace_spec(built("v9")["spec"])
    place.wait_condition("ImageBuilt", "Unknown", "Building")
    failed = the_job(place)
    assert report_ended(
        place.plane, place.namespace, failed, {"fetch": "fatal: couldn't find remote ref v9\n"}, failing="fetch"
    )
    message = place.wait_condition("ImageBuilt", "False", "BuildFailed")["message"]
    assert "fetch: fatal: couldn't find remote ref v9" in message
    assert place.condition("Ready")["status"] == "False"
    proxy.quiet(place.namespace)
    assert [job["metadata"]["name"] for job in place.list(JOB)] == [failed]
    assert image(place) == IMAGE + "7" * 64
    place.replace_spec(built("v3")["spec"])
    place.gone(JOB, failed)
    succeed(place, the_job(place), "9")
    wait_image(place, "9")


def test_the_annotation_builds_a_moved_branch_again(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, built("main"))
    first = the_job(place)
    succeed(place, first)
    wait_image(place, "7")
    place.patch(ROBOT_OFFLOAD, "walker", {"metadata": {"annotations": {REBUILD: "monday"}}})
    place.gone(JOB, first)
    succeed(place, the_job(place), "8")
    wait_image(place, "8")


def test_an_operator_that_was_killed_while_a_build_ended_finds_its_result(place: Place, operator: Operator) -> None:
    place.create(ROBOT_OFFLOAD, built())
    job = the_job(place)
    operator.kill()
    succeed(place, job)
    operator.restart()
    wait_image(place, "7")


def test_a_missing_secret_is_waited_for(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, built(registry={"pushSecret": {"name": "push"}}))
    assert "Secret push" in place.wait_condition("ImageBuilt", "False", "SecretMissing")["message"]
    assert place.list(JOB) == []
    secret = {
        "apiVersion": "v1",
        "kind": "Secret",
        "metadata": {"name": "push"},
        "type": "kubernetes.io/dockerconfigjson",
        "stringData": {".dockerconfigjson": '{"auths": {}}'},
    }
    place.create(SECRET, secret)
    succeed(place, the_job(place))
    wait_image(place, "7")


def test_a_namespace_that_forbids_builds_is_told_in_the_condition(place: Place) -> None:
    labels = {"pod-security.kubernetes.io/enforce": "baseline"}
    place.plane.request(
        "PATCH",
        f"/api/v1/namespaces/{place.namespace}",
        {"metadata": {"labels": labels}},
        "application/merge-patch+json",
    )
    place.create(ROBOT_OFFLOAD, built())
    assert 'PodSecurity "baseline' in place.wait_condition("ImageBuilt", "False", "PodsRefused")["message"]


def test_from_build_back_to_image_nothing_of_the_build_stays(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = place.shape()
    place.replace_spec(built()["spec"])
    job = the_job(place)
    assert image(place) == "registry.example/talker:1"
    succeed(place, job)
    wait_image(place, "7")
    place.replace_spec(walker()["spec"])
    eventually(lambda: place.shape().keys() == before.keys(), "no leftover children", lambda: place.shape().keys())
    assert place.get(CONFIG_MAP, "walker-images") is None
    assert image(place) == "registry.example/talker:1"
