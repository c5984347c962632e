"""The five steps for one RobotOffload: load -> observe -> desired -> apply -> status.

Level-triggered: any event calls `Controller.reconcile` with a name, which reads everything anew. It may be called at
any time and any number of times; a crash between two of its writes is repaired by the next call. The status is worked
out in every pass, whatever the steps before it met, and written only when it differs.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

import structlog

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.checks import CLUSTER_CHECKS, check
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.controller import observe as reading
from robot_offload.controller.apply import Done, applied, carry_out
from robot_offload.controller.clock import Clock
from robot_offload.controller.memory import Memory, summary
from robot_offload.decide import (
    agent,
    builds,
    certificates,
    conditions,
    issuer,
    presence,
    status,
    transitions,
    workloads,
)
from robot_offload.decide.decision import Verdict, yes
from robot_offload.decide.ownership import Key, being_deleted, belongs, key_of
from robot_offload.decide.plan import plan
from robot_offload.errors import SpecError
from robot_offload.kube.errors import ForbiddenError, InvalidObjectError, KubeError, NotFoundError
from robot_offload.kube.kinds import DEPLOYMENT, LEASE, ROBOT_OFFLOAD, SECRET, STATEFUL_SET
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects import labels
from robot_offload.objects.facts import Facts, Images
from robot_offload.objects.names import ROBOT, child_name, discovery_child
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from robot_offload.transport import discovery

Name: TypeAlias = tuple[str, str]
"""Namespace and name of a RobotOffload."""
COMPONENT: Final = "robot-offload-operator"
_STALE_S: Final = 1.0
_log = structlog.get_logger("robot_offload.controller")


@dataclass(frozen=True, slots=True)
class Result:
    """What comes after a pass.

    Attributes:
        again_s: seconds after which to look again though nothing happens; None: only on events.
        failed: whether it is to be tried again soon, ever less often.
        writes: how many writes it made, the status included.
    """

    again_s: float | None = None
    failed: bool = False
    writes: int = 0


class Controller:
    """Keeps every RobotOffload as declared."""

    def __init__(self, api: KubeApi, images: Images, clock: Clock | None = None) -> None:
        self._api = api
        self._images = images
        self._clock = clock or Clock()
        self.memories: dict[Name, Memory] = {}

    async def reconcile(self, name: Name) -> Result:
        """One pass. Calls for the same name must not overlap; the queue sees to that."""
        raw = await self._load(name)
        if raw is None:
            return Result()
        memory = self._memory(name, raw)
        generation = int(raw["metadata"].get("generation") or 0)
        if generation < memory.generation:
            # An answer from the past must not undo what a newer one has led to.
            return Result(again_s=_STALE_S)
        memory.generation = generation
        memory.status = summary(raw.get("status") or {})
        try:
            offload = parse_object(raw, "/".join(name), unknown="ignore", rules=CLUSTER_CHECKS)
        except SpecError as error:
            return await self._refuse(raw, memory, error)
        return await _Pass(self._api, self._images, self._clock, raw, offload, memory).run()

    def news(self, name: Name, manifest: Manifest) -> bool:
        """Whether an event tells anything that the last pass has not read or written itself."""
        memory = self.memories.get(name)
        metadata = manifest["metadata"]
        return memory is None or memory.versions.get(metadata["uid"]) != metadata.get("resourceVersion")

    def saw_lease(self, name: Name, lease: Manifest) -> float | None:
        """A robot's Lease has moved. Returns the seconds for which that settles matters, None when a pass is needed."""
        memory = self.memories.get(name)
        if memory is None or memory.sighting is None or memory.lease is None:
            return None
        memory.sighting = presence.look(memory.sighting, lease, self._clock.steady_s())
        if presence.meaning(lease) != memory.lease or memory.sighting.first:
            return None
        if not (memory.status.get("robot") or {}).get("connected"):
            return None
        return presence.duration_s(lease)

    async def _load(self, name: Name) -> Manifest | None:
        raw = await self._api.get(ROBOT_OFFLOAD, *name)
        if raw is None:
            self.memories.pop(name, None)
            return None
        # On its way out nothing is made any more: owner references do the rest.
        return None if being_deleted(raw) else raw

    def _memory(self, name: Name, raw: Manifest) -> Memory:
        uid = raw["metadata"]["uid"]
        memory = self.memories.get(name)
        if memory is None or memory.uid != uid:
            memory = self.memories[name] = Memory(uid)
        return memory

    async def _refuse(self, raw: Manifest, memory: Memory, error: SpecError) -> Result:
        """An invalid specification: say every problem, touch nothing, wait for a change."""
        verdicts = {"SpecValid": conditions.spec_valid(error.findings)}
        before = raw.get("status") or {}
        after = status.build(before, raw["metadata"].get("generation") or 0, verdicts, self._clock.wall())
        writes = await write_status(self._api, raw, after, memory, self._clock)
        return Result(writes=writes)


class _Pass:
    """One pass over a valid RobotOffload: the steps share what the earlier ones found."""

    def __init__(
        self, api: KubeApi, images: Images, clock: Clock, raw: Manifest, offload: RobotOffload, memory: Memory
    ) -> None:
        self._api = api
        self._images = images
        self._clock = clock
        self._raw = raw
        self._offload = offload
        self._memory = memory
        self._namespace: str = raw["metadata"]["namespace"]
        self._uid: str = raw["metadata"]["uid"]
        self._name: str = raw["metadata"]["name"]
        self._before: Mapping[str, Any] = raw.get("status") or {}
        self._done = Done()
        self._seen = reading.Observed()
        self._handled: set[Key] = set()  # children that an earlier step of this pass has dealt with

    async def run(self) -> Result:
        """All steps; what the API server refuses to show or take for good is told in the status."""
        verdicts = {"SpecValid": conditions.spec_valid((), check(self._offload.spec, CLUSTER_CHECKS))}
        found, again_s = None, None
        try:
            found, again_s = await self._steps(verdicts)
        except (ForbiddenError, InvalidObjectError, NotFoundError) as error:
            self._done.errors.append(error)
            verdicts["ResourcesApplied"] = applied(self._done)
        generation = int(self._raw["metadata"].get("generation") or 0)
        after = status.build(self._before, generation, verdicts, self._clock.wall(), self._offload, found)
        writes = await write_status(self._api, self._raw, after, self._memory, self._clock)
        self._memory.versions |= {
            child["metadata"]["uid"]: child["metadata"]["resourceVersion"] for child in self._seen.live.values()
        }
        return Result(again_s, self._done.failed, self._done.writes + writes)

    async def _steps(self, verdicts: dict[str, Verdict]) -> tuple[status.Found, float | None]:
        """Observe, desired, apply; adds to `verdicts`. Also returns when time alone may change the outcome."""
        self._memory.config_maps = frozenset(name for name, _ in reading.config_maps(self._offload))
        self._seen = await reading.observe(self._api, self._namespace, self._offload)
        robot = self._robot()
        wanted = presence.wanted(self._offload.spec, robot, self._clock.wall())
        facts = self._facts(robot, wanted)
        verdicts["CertificatesReady"], certificates_s = await self._certify(facts)
        built = await self._build(facts)
        hosts = await self._show_discovery(facts)
        facts = replace(facts, certificate_hash=self._certificate_hash(), built=built.references, discovery_hosts=hosts)
        await self._apply((*built.manifests, *children(Parent(self._offload, facts))), built.kept)
        verdicts["ResourcesApplied"] = applied(self._done)
        found = await self._find(robot, wanted, built)
        verdicts |= {"ImageBuilt": built.verdict, **self._verdicts(found)}
        times = (robot.recheck_s, wanted.recheck_s, certificates_s, built.recheck_s)
        again = [after_s for after_s in times if after_s is not None]
        return found, min(again, default=None)

    def _robot(self) -> presence.Presence:
        """The robot's presence; its Lease counts only when it is ours."""
        now_s = self._clock.steady_s()
        lease = self._ours(LEASE, child_name(self._name, ROBOT))
        self._memory.lease = presence.meaning(lease) if lease is not None else None
        self._memory.sighting = presence.look(self._memory.sighting, lease, now_s)
        before = self._before.get("robot") or {}
        return presence.presence(lease, self._memory.sighting, before, now_s, self._clock.wall())

    def _facts(self, robot: presence.Presence, wanted: presence.Wanted) -> Facts:
        services = [service for service in self._seen.services if belongs(service, self._uid)]
        return Facts(
            namespace=self._namespace,
            uid=self._uid,
            generation=int(self._raw["metadata"].get("generation") or 0),
            images=self._images,
            nodes_wanted=wanted.nodes,
            robot_connected=robot.connected,
            endpoints=transport.observed_endpoints(self._offload, services, self._seen.nodes),
            user_config_hashes=self._seen.config_hashes,
            user_configs=self._seen.config_texts,
        )

    async def _certify(self, facts: Facts) -> tuple[Verdict, float | None]:
        """Brings the Secrets up to date before anything reads them."""
        if not transport.needs_certificates(self._offload.spec):
            return yes("NotNeeded", "This transport uses no certificates"), None
        await reading.look_up(self._api, self._namespace, self._seen, self._secret_stubs())
        if self._offload.spec.transport.certificates.issuer_ref is not None:
            return issuer.verdict({role: self._secret(role) for role in certificates.ROLES}), None
        revoke = (self._raw["metadata"].get("annotations") or {}).get(certificates.REVOKE, "")
        live = {role: self._secret(role) for role in certificates.ROLES}
        issued = certificates.issue(Parent(self._offload, facts), live, revoke, self._clock.wall())
        for role, why in issued.made:
            _log.info("Made certificate", **self._told, role=role, reason=why.reason)
        failures = len(self._done.errors) + len(self._done.obstacles)
        await self._apply_among(self._secret_keys(), issued.secrets)
        if len(self._done.errors) + len(self._done.obstacles) > failures:
            refused = applied(self._done)
            return refused, None
        return issued.verdict, issued.recheck_s

    async def _build(self, facts: Facts) -> builds.Builds:
        """Decides about the images that are built here; what there is of them is only read when there are any."""
        if not self._offload.spec.built_nodes:
            return builds.Builds()
        pods = await reading.build_pods(self._api, self._namespace, self._offload)
        missing = await reading.missing_secrets(self._api, self._namespace, builds.secrets_of(self._offload))
        seen = builds.Seen(self._seen.live, pods, missing, self._clock.wall())
        rebuild = (self._raw["metadata"].get("annotations") or {}).get(builds.REBUILD, "")
        return builds.decide(Parent(self._offload, facts), seen, rebuild)

    async def _show_discovery(self, facts: Facts) -> tuple[str, ...]:
        """Applies the Services of the discovery servers before anything needs their addresses; returns these."""
        if not transport.discovery_servers(self._offload.spec):
            return ()
        names = set(discovery.names(self._offload))
        services = [
            each
            for each in transport.of(self._offload.spec).services(Parent(self._offload, facts))
            if each["metadata"]["name"] in names
        ]
        keys = {key_of(each) for each in services}
        await reading.look_up(self._api, self._namespace, self._seen, services)
        await self._apply_among(keys, services)
        self._handled |= keys
        found = discovery.hosts(self._offload, [each for key in keys if (each := self._ours(*key)) is not None])
        if not found:
            # What is there goes on as it is: it must not be pruned because it cannot be rendered now.
            self._handled |= set(self._seen.live)
        return found

    async def _apply_among(self, keys: Iterable[Key], wanted: Iterable[Manifest]) -> None:
        """Applies some children ahead of the others; no other child than those of these keys is looked at."""
        live = {key: self._seen.live[key] for key in keys if key in self._seen.live}
        steps = plan(wanted, live, self._uid, self._memory.settled)
        await carry_out(self._api, steps, self._seen.live, self._memory.settled, self._done)

    async def _apply(self, wanted: Iterable[Manifest], unchanged: Iterable[Key]) -> None:
        """Applies the children in their order and prunes what is no longer one, but for those that stay unchanged."""
        manifests = [manifest for manifest in wanted if key_of(manifest) not in self._handled]
        kept = set(unchanged) | self._handled
        if transport.needs_certificates(self._offload.spec):
            kept |= self._secret_keys()
            if self._offload.spec.transport.certificates.issuer_ref is not None:
                # With an issuer, the authorities are not ours and the leaves are cert-manager's.
                kept -= self._secret_keys()
                kept |= {(SECRET, certificates.secret_name(self._name, role)) for role in ("cloud", "robot")}
                manifests = [*issuer.certificates(Parent(self._offload, self._facts_of_owner())), *manifests]
        await reading.look_up(self._api, self._namespace, self._seen, manifests)
        steps = plan(manifests, self._seen.live, self._uid, self._memory.settled, kept)
        await carry_out(self._api, steps, self._seen.live, self._memory.settled, self._done)
        if self._done.writes:
            _log.info("Applied", **self._told, writes=self._done.writes, errors=len(self._done.errors))

    async def _find(self, robot: presence.Presence, wanted: presence.Wanted, built: builds.Builds) -> status.Found:
        lease = self._ours(LEASE, child_name(self._name, ROBOT))
        state, problem = agent.state_of(lease)
        services = [service for service in self._seen.services if belongs(service, self._uid)]
        pods: tuple[Manifest, ...] = ()
        if not all(workloads.workload(child).holds for child in self._workloads()):
            pods = await reading.pods(self._api, self._namespace, self._offload)
        return status.Found(
            robot=robot,
            robot_generation=state.settings.robot_generation if state is not None else None,
            placement=agent.placement(state, problem, connected=robot.connected),
            endpoints=transport.observed_endpoints(self._offload, services, self._seen.nodes),
            wanted=wanted,
            live={key: child for key, child in self._seen.live.items() if belongs(child, self._uid)},
            pods=pods,
            commits={node: image.commit for node, image in built.images.items()},
        )

    def _verdicts(self, found: status.Found) -> dict[str, Verdict]:
        """The conditions that follow from what is live."""
        lease = self._ours(LEASE, child_name(self._name, ROBOT))
        state, _ = agent.state_of(lease)
        servers = transport.discovery_servers(self._offload.spec)
        names = [discovery_child(self._name, server) for server in range(servers)]
        sets = [found.live[key] for name in names if (key := (STATEFUL_SET, name)) in found.live]
        deployments = [child for (kind, _), child in found.live.items() if kind == DEPLOYMENT]
        judged = [workloads.workload(child, workloads.pods_of(child, found.pods)) for child in deployments]
        fine = yes("Available", "All workloads are available")
        if not found.wanted.nodes:
            fine = yes(found.wanted.verdict.reason, found.wanted.verdict.message)
        generation = int(self._raw["metadata"].get("generation") or 0)
        return {
            "DiscoveryReady": conditions.discovery_ready(
                servers, [workloads.workload(child, workloads.pods_of(child, found.pods)) for child in sets]
            ),
            "WorkloadsAvailable": workloads.together(judged, fine),
            "AgentConnected": found.robot.verdict,
            "AgentConfigCurrent": agent.config_current(state, generation, connected=found.robot.connected),
        }

    def _workloads(self) -> list[Manifest]:
        return [child for (kind, _), child in self._seen.live.items() if kind in (DEPLOYMENT, STATEFUL_SET)]

    def _ours(self, kind: Any, name: str) -> Manifest | None:
        child = self._seen.live.get((kind, name))
        return child if child is not None and belongs(child, self._uid) else None

    def _secret(self, role: certificates.Role) -> Manifest | None:
        return self._ours(SECRET, certificates.secret_name(self._name, role))

    def _secret_keys(self) -> set[Any]:
        return {(SECRET, certificates.secret_name(self._name, role)) for role in certificates.ROLES}

    def _secret_stubs(self) -> list[Manifest]:
        """The Secrets by name only, to ask who has them."""
        return [
            {"apiVersion": SECRET.api_version, "kind": SECRET.kind, "metadata": {"name": name}}
            for _, name in self._secret_keys()
        ]

    def _certificate_hash(self) -> str:
        return certificates.content_hash(self._secret("cloud"))

    def _facts_of_owner(self) -> Facts:
        return Facts(self._namespace, self._uid, 0, self._images, nodes_wanted=False)

    @property
    def _told(self) -> dict[str, str]:
        return {"namespace": self._namespace, "name": self._name}


async def write_status(api: KubeApi, raw: Manifest, after: Mapping[str, Any], memory: Memory, clock: Clock) -> int:
    """Writes the status where it differs and posts the transitions; returns the number of writes."""
    before = raw.get("status") or {}
    change = status.patch(before, after)
    metadata = raw["metadata"]
    memory.versions = {metadata["uid"]: metadata["resourceVersion"]}
    if not change:
        return 0
    answer = await api.patch_status(
        {
            "apiVersion": ROBOT_OFFLOAD.api_version,
            "kind": ROBOT_OFFLOAD.kind,
            "metadata": {key: metadata[key] for key in ("namespace", "name", "uid", "resourceVersion")},
            "status": change,
        }
    )
    memory.versions[metadata["uid"]] = answer["metadata"]["resourceVersion"]
    memory.status = summary(after)
    told = transitions.transitions(before, after)
    for event in told:
        try:
            await api.create(_event(raw, event, clock))
        except KubeError as error:
            # An event is a courtesy: losing one must not undo the pass.
            _log.warning("Lost an event", name=metadata["name"], namespace=metadata["namespace"], error=str(error))
    return 1 + len(told)


def _event(raw: Manifest, told: transitions.Told, clock: Clock) -> Manifest:
    metadata = raw["metadata"]
    moment = conditions.timestamp(clock.wall())
    return {
        "apiVersion": "v1",
        "kind": "Event",
        "metadata": {
            "name": f"{metadata['name']}.{secrets.token_hex(6)}",
            "namespace": metadata["namespace"],
            "labels": {labels.MANAGED_BY: labels.MANAGER},
        },
        "involvedObject": {
            "apiVersion": raw["apiVersion"],
            "kind": raw["kind"],
            "namespace": metadata["namespace"],
            "name": metadata["name"],
            "uid": metadata["uid"],
            "resourceVersion": metadata["resourceVersion"],
        },
        "type": told.type,
        "reason": told.reason,
        "message": told.message,
        "source": {"component": COMPONENT},
        "reportingComponent": COMPONENT,
        "firstTimestamp": moment,
        "lastTimestamp": moment,
        "count": 1,
    }
