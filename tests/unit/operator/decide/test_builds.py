"""Images that are built in the cluster: which Job is wanted, what a node runs meanwhile, and what people are told."""

from __future__ import annotations

import copy
import dataclasses
import datetime
import json
from typing import Any

import pytest

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide.builds import Before, Builds, decide, image_of, secrets_of
from robot_offload.decide.ownership import Key, key_of
from robot_offload.decide.plan import plan
from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, JOB
from robot_offload.kube.port import Manifest
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from tests.unit.operator.decide.worlds import FACTS, NOW, offload

BUILD: dict[str, Any] = {
    "git": {"url": "https://git.example/robot.git", "ref": "main", "paths": ["src/talker"]},
    "package": "demo_nodes_cpp",
    "executable": "talker",
}
NODE: dict[str, Any] = {
    "name": "talker",
    "placement": "Duplicated",
    "run": {"package": "demo_nodes_cpp", "executable": "talker"},
    "build": BUILD,
}
REGISTRY: dict[str, Any] = {"repository": "registry.example/fleet", "pushSecret": {"name": "push"}}
COMMIT, DIGEST = "8a5b1c2d3e4f5a6b7c8d9e0f1a2b3c4d5e6f7a8b", "sha256:" + "7" * 64
IMAGE = f"registry.example/fleet/demo_nodes_cpp@{DIGEST}"
FAILED = {"type": "Failed", "status": "True", "reason": "PodFailurePolicy", "message": "a pod failed"}
COMPLETE = {"type": "Complete", "status": "True"}


def built(*nodes: dict[str, Any], **build: Any) -> RobotOffload:
    """A RobotOffload whose nodes are built; keywords are fields of the build block."""
    return offload(
        cloud={"registry": REGISTRY}, nodes=list(nodes) or [{**copy.deepcopy(NODE), "build": {**BUILD, **build}}]
    )


class World:
    """What the cluster has. Decisions are carried out as the operator does: made, kept or pruned."""

    def __init__(self) -> None:
        self.live: dict[Key, Manifest] = {}
        self.pods: list[Manifest] = []
        self.missing: frozenset[str] = frozenset()
        self.types: dict[str, str] = {}
        self.now = NOW

    def decide(self, wanted: RobotOffload, rebuild: str = "") -> Builds:
        return decide(Parent(wanted, FACTS), Before(self.live, self.pods, self.missing, self.now, self.types), rebuild)

    def turn(self, wanted: RobotOffload, rebuild: str = "") -> Builds:
        """One pass of the operator."""
        decision = self.decide(wanted, rebuild)
        facts = dataclasses.replace(FACTS, built=decision.references)
        manifests = (*decision.manifests, *children(Parent(wanted, facts)))
        steps = plan(manifests, self.live, FACTS.uid, prunable=self.live.keys() - decision.kept)
        assert not steps.obstacles
        for step in steps.applies:
            there = self.live.get(key_of(step.manifest), {}).get("metadata", {})
            metadata = {"uid": f"uid-{len(self.live)}", "creationTimestamp": self.now.isoformat(), **there}
            self.live[key_of(step.manifest)] = {**step.manifest, "metadata": {**metadata, **step.manifest["metadata"]}}
        for gone in steps.deletes:
            del self.live[key_of(gone)]
        return decision

    @property
    def jobs(self) -> list[Manifest]:
        return [manifest for (kind, _), manifest in self.live.items() if kind == JOB]

    @property
    def job(self) -> Manifest:
        [job] = self.jobs
        return job

    @property
    def running(self) -> str | None:
        """The image of the node's Deployment."""
        deployment = self.live.get((DEPLOYMENT, "walker-talker"))
        return image_of(deployment) or None

    def end(self, condition: dict[str, Any], message: str = "", *, code: int = 0, step: str = "push") -> None:
        """The Job ends, its pod with it."""
        self.job["status"] = {"conditions": [condition]}
        ended = {"name": step, "state": {"terminated": {"exitCode": code, "message": message}}}
        owner = {"kind": "Job", "uid": self.job["metadata"]["uid"], "controller": True}
        key = "containerStatuses" if step == "push" else "initContainerStatuses"
        self.pods = [{"metadata": {"name": "pod", "ownerReferences": [owner]}, "status": {key: [ended]}}]

    def succeed(self, digest: str = DIGEST) -> None:
        self.end(COMPLETE, json.dumps({"commit": COMMIT, "digest": digest}))


def test_a_robot_offload_without_a_build_block_needs_nothing() -> None:
    decision = World().turn(offload())
    assert (decision.verdict.truth, decision.verdict.reason) == ("True", "NotNeeded")
    assert decision.manifests == ()


def test_a_job_is_made_and_the_node_waits_for_its_first_image() -> None:
    world = World()
    decision = world.turn(built())
    assert (decision.verdict.truth, decision.verdict.reason) == ("Unknown", "Building")
    assert world.job["metadata"]["name"].startswith("walker-build-demo-nodes-cpp-")
    assert world.running is None


def test_the_image_that_was_built_is_run_by_its_digest_and_written_down() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    decision = world.turn(built())
    assert (decision.verdict.reason, decision.images["talker"].commit) == ("Built", COMMIT)
    assert world.running == IMAGE
    assert IMAGE in world.live[CONFIG_MAP, "walker-images"]["data"]["talker"]


def test_once_written_down_neither_job_nor_pods_are_needed() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    del world.live[JOB, world.job["metadata"]["name"]]
    world.pods = []
    assert world.turn(built()).verdict.reason == "Built"
    assert world.jobs == []
    assert world.running == IMAGE
    assert not [name for kind, name in world.live if kind == CONFIG_MAP and "-build-" in name]


def test_an_unchanged_object_leads_to_no_write() -> None:
    world = World()
    for after in ("made", "failed", "succeeded"):
        world.turn(built())
        if after == "failed":
            world.end(FAILED, code=1)
        elif after == "succeeded":
            world.succeed()
        world.turn(built())
        decision = world.decide(built())
        facts = dataclasses.replace(FACTS, built=decision.references)
        wanted = (*decision.manifests, *children(Parent(built(), facts)))
        assert not plan(wanted, world.live, FACTS.uid, prunable=world.live.keys() - decision.kept).touched


def test_a_changed_source_is_built_while_the_old_image_runs_and_its_old_job_goes() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    old = world.job["metadata"]["name"]
    changed = built(git={**BUILD["git"], "ref": "v2"})
    assert world.turn(changed).verdict.reason == "Building"
    assert world.job["metadata"]["name"] != old
    assert world.running == IMAGE
    world.succeed("sha256:" + "8" * 64)
    world.turn(changed)
    assert world.running == IMAGE.replace("7", "8")


def test_going_back_to_what_ran_before_the_new_build_was_done_keeps_it() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    world.turn(built(executable="other"))
    assert world.turn(built()).verdict.reason == "Built"
    assert world.running == IMAGE


def test_a_failed_build_keeps_the_old_image_tells_the_failing_line_and_makes_no_second_job() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    broken = built(executable="tolker")
    world.turn(broken)
    log = 'Package demo_nodes_cpp has no executable tolker. It has:\ntalker\nError: building at STEP "RUN x": exit 1'
    world.end(FAILED, log, code=1, step="build")
    name = world.job["metadata"]["name"]
    for _ in range(3):
        verdict = world.turn(broken).verdict
    assert (verdict.truth, verdict.reason) == ("False", "BuildFailed")
    assert "build: Package demo_nodes_cpp has no executable tolker. It has:" in verdict.message
    assert "building at STEP" not in verdict.message
    assert world.job["metadata"]["name"] == name
    assert world.running == IMAGE


def test_of_several_pods_the_newest_tells_why() -> None:
    world = World()
    world.turn(built())
    world.end(FAILED, "error: the last one", code=1, step="build")
    [newest] = world.pods
    evicted = copy.deepcopy(newest)
    evicted["metadata"]["creationTimestamp"] = "2026-11-21T12:00:00Z"
    evicted["status"]["initContainerStatuses"][0]["state"]["terminated"]["message"] = "error: evicted"
    newest["metadata"]["creationTimestamp"] = "2026-11-21T12:05:00Z"
    world.pods = [evicted, newest]
    assert "the last one" in world.turn(built()).verdict.message


def test_a_build_that_ran_out_of_time_is_told_by_the_job() -> None:
    world = World()
    world.turn(built())
    world.job["status"] = {"conditions": [{**FAILED, "reason": "DeadlineExceeded", "message": "was active too long"}]}
    assert "DeadlineExceeded: was active too long" in world.turn(built()).verdict.message


def test_a_failed_job_that_is_gone_is_tried_again() -> None:
    world = World()
    world.turn(built())
    world.end(FAILED, "fatal: no", code=1, step="fetch")
    world.turn(built())
    del world.live[JOB, world.job["metadata"]["name"]]
    assert world.turn(built()).verdict.reason == "Building"
    assert len(world.jobs) == 1


def test_another_text_in_the_annotation_builds_again() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    first = world.job["metadata"]["name"]
    world.turn(built(), rebuild="monday")
    assert world.job["metadata"]["name"] != first
    assert world.running == IMAGE


def test_a_lost_record_costs_a_build_and_never_the_running_pod() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    for key in [(JOB, world.job["metadata"]["name"]), (CONFIG_MAP, "walker-images")]:
        del world.live[key]
    world.pods = []
    assert world.turn(built()).verdict.reason == "Building"
    assert world.running == IMAGE


@pytest.mark.parametrize(
    "entry",
    [
        "no json",
        "[]",
        "null",
        '{"key": 1}',
        json.dumps({"key": "a", "image": "evil:latest", "commit": COMMIT}),
        json.dumps({"key": 7, "image": IMAGE, "commit": COMMIT}),
        json.dumps({"key": "a", "image": IMAGE, "commit": "$(reboot)"}),
    ],
)
def test_a_record_that_somebody_has_spoilt_is_no_record(entry: str) -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    world.live[CONFIG_MAP, "walker-images"]["data"]["talker"] = entry
    assert world.turn(built()).verdict.reason == "Built"
    assert world.running == IMAGE


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{}",
        "null",
        json.dumps({"commit": COMMIT, "digest": "latest"}),
        json.dumps({"commit": "main", "digest": DIGEST}),
        json.dumps({"commit": COMMIT, "digest": f"{DIGEST}\nevil"}),
    ],
)
def test_a_job_that_does_not_say_what_it_built_makes_way_for_another(message: str) -> None:
    world = World()
    world.turn(built())
    world.end(COMPLETE, message)
    world.turn(built())
    assert world.jobs == []
    world.turn(built())
    assert len(world.jobs) == 1
    assert world.running is None


def test_what_a_strangers_pod_says_is_not_heard() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.pods[0]["metadata"]["ownerReferences"][0]["uid"] = "somebody"
    assert "talker" not in world.decide(built()).images


def test_two_nodes_of_one_source_are_built_once() -> None:
    world = World()
    both = built(NODE, {**NODE, "name": "second"})
    world.turn(both)
    world.succeed()
    decision = world.turn(both)
    assert decision.references == {"talker": IMAGE, "second": IMAGE}


def test_nodes_for_other_computers_are_built_there() -> None:
    world = World()
    world.turn(built(NODE, {**NODE, "name": "second", "nodeSelector": {"kubernetes.io/arch": "arm64", "gpu": "yes"}}))
    places = [job["spec"]["template"]["spec"].get("nodeSelector") for job in world.jobs]
    assert places == [None, {"kubernetes.io/arch": "arm64"}]


def test_a_secret_of_another_type_is_not_read() -> None:
    world = World()
    world.types = {"push": "Opaque"}
    decision = world.turn(built())
    assert (decision.verdict.truth, decision.verdict.reason) == ("False", "SecretType")
    assert "Secret push is not of type kubernetes.io/dockerconfigjson" in decision.verdict.message
    assert not world.jobs
    world.types = {"push": "kubernetes.io/dockerconfigjson"}
    world.turn(built())
    assert world.jobs


def test_nothing_is_built_where_the_administrator_has_not_allowed_it_and_what_was_built_goes_on() -> None:
    world = World()
    forbidding = dataclasses.replace(FACTS, images=dataclasses.replace(FACTS.images, git=""))
    before = Before(world.live, (), frozenset(), NOW)
    refused = decide(Parent(built(), forbidding), before, "")
    assert (refused.verdict.truth, refused.verdict.reason, refused.manifests) == ("False", "BuildsDisabled", ())
    world.turn(built())
    world.succeed()
    world.turn(built())
    later = decide(Parent(built(), forbidding), Before(world.live, (), frozenset(), NOW), "")
    assert (later.verdict.truth, later.references) == ("True", {"talker": IMAGE})


def test_a_missing_secret_is_named_and_looked_for_again_before_any_job_is_made() -> None:
    world = World()
    world.missing = frozenset({"push"})
    decision = world.turn(built())
    assert (decision.verdict.truth, decision.verdict.reason) == ("False", "SecretMissing")
    assert "Secret push" in decision.verdict.message
    assert decision.recheck_s
    assert not world.jobs
    world.missing = frozenset()
    world.turn(built())
    assert world.jobs


def test_the_secrets_that_builds_read() -> None:
    private = built({**NODE, "build": {**BUILD, "gitSecret": {"name": "git"}}})
    assert secrets_of(private) == {"push", "git"}
    assert secrets_of(offload(cloud={"registry": REGISTRY})) == frozenset()


def test_what_the_api_server_says_against_the_pod_of_a_build_is_quoted() -> None:
    world = World()
    world.turn(built())
    (job,) = (name for kind, name in world.live if kind.kind == "Job")
    before = Before(world.live, (), frozenset(), NOW, refusals={job: 'pods "x" is forbidden: exceeded quota: small'})
    verdict = decide(Parent(built(), FACTS), before, "").verdict
    assert (verdict.truth, verdict.reason) == ("False", "PodsRefused")
    assert "exceeded quota: small" in verdict.message


def test_a_job_without_a_pod_is_told_after_a_while_with_what_a_build_needs() -> None:
    world = World()
    world.turn(built())
    decision = world.turn(built())
    assert (decision.verdict.reason, decision.recheck_s) == ("Building", 20)
    world.now = NOW + datetime.timedelta(seconds=21)
    refused = world.turn(built()).verdict
    assert (refused.truth, refused.reason) == ("False", "PodsRefused")
    assert "Pod Security" in refused.message
    world.job["status"] = {"active": 1}
    assert world.turn(built()).verdict.reason == "Building"


def test_a_pod_that_cannot_start_says_why() -> None:
    world = World()
    world.turn(built())
    owner = {"kind": "Job", "uid": world.job["metadata"]["uid"], "controller": True}
    waiting = {"name": "fetch", "image": "ros:jazzy", "state": {"waiting": {"reason": "ImagePullBackOff"}}}
    world.pods = [{"metadata": {"ownerReferences": [owner]}, "status": {"initContainerStatuses": [waiting]}}]
    assert "ros:jazzy cannot be pulled" in world.turn(built()).verdict.message


def test_a_newer_operator_with_another_builder_leaves_running_jobs_as_they_are() -> None:
    world = World()
    world.turn(built())
    images = dataclasses.replace(FACTS.images, builder="registry.example/buildah:2")
    newer = dataclasses.replace(FACTS, images=images)
    decision = decide(Parent(built(), newer), Before(world.live, (), frozenset(), NOW), "")
    assert decision.manifests == ()
    assert {kind for kind, _ in decision.kept} == {JOB, CONFIG_MAP}


def test_from_image_to_build_the_old_image_runs_until_the_new_one_is_there() -> None:
    world = World()
    world.turn(offload())
    assert world.running == "talker:1"
    world.turn(built())
    assert world.running == "talker:1"
    world.succeed()
    world.turn(built())
    assert world.running == IMAGE


def test_from_build_to_image_everything_of_the_build_goes() -> None:
    world = World()
    world.turn(built())
    world.succeed()
    world.turn(built())
    world.turn(offload())
    assert world.running == "talker:1"
    assert not [name for kind, name in world.live if kind == JOB or "build" in name or "images" in name]
