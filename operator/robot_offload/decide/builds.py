"""The life of the images that are built in the cluster: the wanted Job, its result, and what a node runs.

Results are recorded in a ConfigMap, because Jobs and their pods go away. While another image is built a node keeps its
present one. Only the operator writes that record; losing it costs a build, never a running pod.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide.build_log import failing_lines
from robot_offload.decide.build_specs import build_plans
from robot_offload.decide.ownership import Key, being_deleted, belongs, controller_of
from robot_offload.decide.verdicts import Verdict, no, unknown, yes
from robot_offload.decide.workloads import pod_trouble
from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, JOB
from robot_offload.kube.port import Manifest
from robot_offload.objects.names import IMAGES, child_name, node_child
from robot_offload.objects.parent import Parent, Part
from robot_offload.render.build_job import BuildPlan, build_files, build_job

REBUILD: Final = "robotoffload.dev/rebuild"
"""Annotation on the RobotOffload: new text in it requests a build of every image from the branches' present state."""
SECRET_WAIT_S: Final = 15.0
"""Seconds after which a missing Secret is looked for again: Secrets of users are not watched."""
_POD_WAIT_S: Final = 20.0
"""Seconds after which a Job without a pod is reported as refused."""
_DIGEST: Final = re.compile(r"sha256:[0-9a-f]{64}")
_COMMIT: Final = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")


@dataclass(frozen=True, slots=True)
class Built:
    """An image that was built.

    Attributes:
        key: of its build; empty: no longer known.
        image: its reference, by digest.
        commit: of the source; empty: no longer known.
    """

    key: str
    image: str
    commit: str


@dataclass(frozen=True, slots=True)
class Builds:
    """The decision about the images of one RobotOffload.

    Attributes:
        manifests: objects to create: the record, and Jobs with their files.
        kept: objects that stay as they are: a Job never changes.
        images: the image of each node; a node without an image yet is missing.
        verdict: for the condition ImageBuilt.
        recheck_s: seconds after which time alone may change this; None: never.
    """

    manifests: tuple[Manifest, ...] = ()
    kept: frozenset[Key] = frozenset()
    images: Mapping[str, Built] = field(default_factory=dict)
    verdict: Verdict = field(default_factory=lambda: yes("NotNeeded", "No node has a build block"))
    recheck_s: float | None = None

    @property
    def references(self) -> dict[str, str]:
        """The images by node, as rendering wants them."""
        return {node: built.image for node, built in self.images.items()}


@dataclass(frozen=True, slots=True)
class Before:
    """The present state.

    Attributes:
        live: objects with the children's labels, of any owner.
        pods: of the build Jobs.
        secrets_missing: names of missing Secrets that builds need.
        secret_types: types of the existing ones, by name.
        now: our wall clock.
        refusals: why the API server refuses the pods of Jobs, by the Jobs' names.
    """

    live: Mapping[Key, Manifest]
    pods: Sequence[Manifest]
    secrets_missing: frozenset[str]
    now: datetime.datetime
    secret_types: Mapping[str, str] = field(default_factory=dict)
    refusals: Mapping[str, str] = field(default_factory=dict)


def secrets_of(offload: RobotOffload) -> frozenset[str]:
    """Return the names of all Secrets that the builds read."""
    registry = offload.spec.cloud.registry
    found = [node.build.git_secret for node in offload.spec.built_nodes if node.build is not None]
    if offload.spec.built_nodes and registry is not None:
        found += [registry.push_secret, registry.pull_secret]
    return frozenset(secret.name for secret in found if secret is not None)


def decide(parent: Parent, seen: Before, rebuild: str) -> Builds:
    """Decide about all images.

    Args:
        parent: a valid RobotOffload.
        seen: the present state.
        rebuild: the text of the annotation `REBUILD`; empty: none.
    """
    plans = build_plans(parent.offload, rebuild)
    if not plans:
        return Builds()
    ours = {key: child for key, child in seen.live.items() if belongs(child, parent.uid)}
    name = child_name(parent.name, IMAGES)
    images = _recorded(parent.offload, ours, name)
    steps = [_step(parent, plan, seen, ours, images) for plan in plans]
    for plan, step in zip(plans, steps, strict=True):
        if step.built is not None:
            images |= dict.fromkeys(plan.nodes, step.built)
    record = {node: _written(built) for node, built in sorted(images.items()) if built.key}
    manifests = [manifest for step in steps for manifest in step.manifests]
    if record:
        manifests.insert(0, parent.config_map(Part(name, "build"), record))
    rechecks = [step.recheck_s for step in steps if step.recheck_s is not None]
    return Builds(
        tuple(manifests),
        frozenset(key for step in steps for key in step.kept),
        images,
        _together([step.verdict for step in steps]),
        min(rechecks, default=None),
    )


@dataclass(frozen=True, slots=True)
class _Step:
    """The decision about one image."""

    verdict: Verdict
    manifests: tuple[Manifest, ...] = ()
    kept: tuple[Key, ...] = ()
    built: Built | None = None
    recheck_s: float | None = None


def _step(
    parent: Parent,
    plan: BuildPlan,
    seen: Before,
    ours: Mapping[Key, Manifest],
    images: Mapping[str, Built],
) -> _Step:
    job, files = ours.get((JOB, plan.name)), ours.get((CONFIG_MAP, plan.name))
    kept = tuple(key for key, it in (((JOB, plan.name), job), ((CONFIG_MAP, plan.name), files)) if it is not None)
    known = next((built for node in plan.nodes if (built := images.get(node)) and built.key == plan.key), None)
    if known is not None:
        # Its files are needed only as long as its Job exists.
        return _Step(yes("Built", _told(plan, known)), kept=kept if job is not None else (), built=known)
    if job is None:
        return _begin(parent, plan, seen, files)
    pods = [pod for pod in seen.pods if (controller_of(pod) or {}).get("uid") == job["metadata"]["uid"]]
    # The newest first: an evicted one reports nothing.
    pods.sort(key=lambda pod: pod["metadata"].get("creationTimestamp") or "", reverse=True)
    if being_deleted(job):
        return _Step(unknown("Building", f"{_subject(plan)} is built again when Job {plan.name} is gone"), kept=kept)
    if _condition(job, "Complete"):
        built = _result(plan, pods)
        if built is not None:
            return _Step(yes("Built", _told(plan, built)), kept=kept, built=built)
        # Its pod was gone before its digest was read, and without a digest nothing can run: the Job is deleted.
        return _Step(unknown("Building", f"what Job {plan.name} built is not known; {_subject(plan)} is built again"))
    if failed := _condition(job, "Failed"):
        return _Step(_failed(plan, failed, pods), kept=kept)
    missing = () if files is not None else (build_files(parent, plan),)
    verdict, recheck_s = _under_way(plan, job, pods, seen.now, seen.refusals.get(plan.name, ""))
    return _Step(verdict, missing, kept, recheck_s=recheck_s)


def _begin(parent: Parent, plan: BuildPlan, seen: Before, files: Manifest | None) -> _Step:
    if not parent.facts.images.git:
        message = "this cluster builds no images (chart value builds.enabled); build it elsewhere and name it in image"
        return _Step(no("BuildsDisabled", f"{_subject(plan)} is not built: {message}"))
    for secret, kind in _secrets(plan):
        if secret in seen.secrets_missing:
            message = f"{_subject(plan)} cannot be built: there is no Secret {secret}; create it in this namespace"
            return _Step(no("SecretMissing", message), recheck_s=SECRET_WAIT_S)
        if seen.secret_types.get(secret, kind) != kind:
            message = f"{_subject(plan)} cannot be built: Secret {secret} is not of type {kind}; make one that is"
            return _Step(no("SecretType", message), recheck_s=SECRET_WAIT_S)
    kept = () if files is None else ((CONFIG_MAP, plan.name),)
    made = () if files is not None else (build_files(parent, plan),)
    return _Step(
        unknown("Building", f"{_subject(plan)} is about to be built by Job {plan.name}"),
        (*made, build_job(parent, plan)),
        kept,
    )


def _secrets(plan: BuildPlan) -> Iterator[tuple[str, str]]:
    """Yield the Secrets that a build reads, each with its only permitted type."""
    if plan.build.git_secret is not None:
        kind = "ssh-auth" if plan.build.git.over_ssh else "basic-auth"
        yield plan.build.git_secret.name, f"kubernetes.io/{kind}"
    for secret in (plan.registry.push_secret, plan.registry.pull_secret):
        if secret is not None:
            yield secret.name, "kubernetes.io/dockerconfigjson"


def _under_way(
    plan: BuildPlan, job: Manifest, pods: Sequence[Manifest], now: datetime.datetime, refusal: str
) -> tuple[Verdict, float | None]:
    if refusal:
        return no(
            "PodsRefused", f"{_subject(plan)}: the API server refuses the pod of Job {plan.name}: {refusal}"
        ), _POD_WAIT_S
    trouble = pod_trouble(plan.name, pods)
    if trouble is not None:
        return unknown("Building", f"{_subject(plan)} is waiting: {trouble.message}"), None
    if pods or (job.get("status") or {}).get("active"):
        message = f"{_subject(plan)} is being built; follow it with: kubectl logs -f job/{plan.name} -c build"
        return unknown("Building", message), None
    created = datetime.datetime.fromisoformat(job["metadata"]["creationTimestamp"])
    left_s = _POD_WAIT_S - (now - created).total_seconds()
    if left_s > 0:
        return unknown("Building", f"{_subject(plan)} waits for a pod of Job {plan.name}"), left_s
    return no(
        "PodsRefused",
        f"{_subject(plan)}: Job {plan.name} gets no pod; `kubectl describe job {plan.name}` says why. Builds need a "
        "namespace that enforces neither Pod Security level restricted nor baseline, and room in its quota",
    ), None


def _failed(plan: BuildPlan, failed: Mapping[str, Any], pods: Sequence[Manifest]) -> Verdict:
    lines = failing_lines(pods)
    why = f"\n{lines}" if lines else f" {failed.get('reason', '')}: {failed.get('message', '')}"
    return no(
        "BuildFailed",
        f"{_subject(plan)} could not be built (Job {plan.name}):{why}\nCorrect the source or the build block; or try "
        f"again with: kubectl delete job {plan.name}",
    )


def _recorded(offload: RobotOffload, ours: Mapping[Key, Manifest], name: str) -> dict[str, Built]:
    """Return each node's present image: from the record, or else from the running Deployment."""
    record = (ours.get((CONFIG_MAP, name)) or {}).get("data") or {}
    found = {}
    for node in offload.spec.built_nodes:
        built = _read(record.get(node.name))
        running = image_of(ours.get((DEPLOYMENT, node_child(offload.metadata.name, node.name))))
        if built is not None:
            found[node.name] = built
        elif running:
            found[node.name] = Built("", running, "")
    return found


def _read(text: object) -> Built | None:
    try:
        entry = json.loads(text) if isinstance(text, str) else None
        built = Built(entry["key"], entry["image"], entry["commit"]) if isinstance(entry, Mapping) else None
    except (ValueError, KeyError):
        return None
    if built is None or not _DIGEST.fullmatch(str(built.image).rpartition("@")[2]):
        return None
    return built if isinstance(built.key, str) and _COMMIT.fullmatch(str(built.commit)) else None


def _written(built: Built) -> str:
    return json.dumps({"key": built.key, "image": built.image, "commit": built.commit})


def image_of(deployment: Manifest | None) -> str:
    """Return the image of a Deployment; empty: there is none."""
    template = ((deployment or {}).get("spec") or {}).get("template") or {}
    containers = (template.get("spec") or {}).get("containers") or [{}]
    return str(containers[0].get("image") or "")


def _result(plan: BuildPlan, pods: Iterable[Manifest]) -> Built | None:
    """Return what the pod that pushed reported."""
    for pod in pods:
        for container in (pod.get("status") or {}).get("containerStatuses") or ():
            ended = (container.get("state") or {}).get("terminated") or {}
            try:
                told = json.loads(ended.get("message") or "")
                commit, digest = str(told["commit"]), str(told["digest"])
            except (ValueError, KeyError, TypeError):
                continue
            if ended.get("exitCode") == 0 and _COMMIT.fullmatch(commit) and _DIGEST.fullmatch(digest):
                return Built(plan.key, f"{plan.repository}@{digest}", commit)
    return None


def _condition(job: Manifest, kind: str) -> Mapping[str, Any] | None:
    for condition in (job.get("status") or {}).get("conditions") or ():
        if condition.get("type") == kind and condition.get("status") == "True":
            return dict(condition)
    return None


def _together(verdicts: Sequence[Verdict]) -> Verdict:
    """Combine verdicts: the first failure, else what is still being built, else that all images exist."""
    for truth, make in (("False", no), ("Unknown", unknown)):
        found = [verdict for verdict in verdicts if verdict.truth == truth]
        if found:
            return make(found[0].reason, "; ".join(verdict.message for verdict in found))
    return yes("Built", "; ".join(verdict.message for verdict in verdicts))


def _subject(plan: BuildPlan) -> str:
    return f"The image of {' and '.join(plan.nodes)}"


def _told(plan: BuildPlan, built: Built) -> str:
    return f"{_subject(plan)} was built from commit {built.commit[:12]}"
