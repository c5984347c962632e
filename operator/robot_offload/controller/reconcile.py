"""The five steps for one RobotOffload: load -> observe -> desired -> apply -> publish.

Level-triggered: any event calls `Controller.reconcile` with a name, which looks at everything anew. It may be called at
any time and any number of times; a crash between two of its writes is repaired by the next call. The status is worked
out in every pass, whatever the steps before it met, and written only when it differs.

Children are applied in three waves, because each needs what the one before has led to: the Secrets with certificates,
the Services of the discovery servers, the rest.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import structlog

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, check
from robot_offload.controller import observe
from robot_offload.controller.apply import Applied, carry_out
from robot_offload.controller.clock import Clock
from robot_offload.controller.failures import Step, verdict_of
from robot_offload.controller.memory import Memory, summary
from robot_offload.controller.publish import publish
from robot_offload.controller.subject import Subject
from robot_offload.decide import agent, builds, certificates, conditions, issuer, presence, status, workloads
from robot_offload.decide.ownership import Key, being_deleted, key_of
from robot_offload.decide.plan import plan
from robot_offload.decide.verdicts import Verdict, yes
from robot_offload.errors import RobotOffloadError, SpecError
from robot_offload.kube.errors import KubeError, NotLeaderError
from robot_offload.kube.kinds import LEASE, ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects.facts import Endpoint, Facts, Images
from robot_offload.objects.names import ROBOT, child_name
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from robot_offload.transport import discovery

Name: TypeAlias = tuple[str, str]
"""Namespace and name of a RobotOffload."""
RENDER_S: Final = 20.0
"""Seconds after which a rendering is given up. 64 nodes with the largest parameter files take less than two."""
PATIENCE: Final = 3
"""Passes in a row that a passing trouble of the API server may break off before the status says so."""
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
        """Makes one pass. Calls for the same name must not overlap; the queue sees to that."""
        raw = await self._load(name)
        if raw is None:
            return Result()
        memory = self._memory(name, raw)
        memory.status = summary(raw.get("status") or {})
        subject = Subject(raw)
        found = _Findings()
        try:
            offload = parse_object(raw, "/".join(name), unknown="ignore", rules=CLUSTER_CHECKS)
            found.verdicts["SpecValid"] = conditions.spec_valid((), check(offload.spec, CLUSTER_CHECKS))
            await _Pass(self._api, self._images, self._clock, subject, offload, memory, found).run()
        except SpecError as error:
            # Every problem is reported, nothing is touched, and the next pass waits for a change.
            found.verdicts["SpecValid"] = conditions.spec_valid(error.findings)
        except NotLeaderError:
            raise
        except Exception as error:
            self._note_failure(error, found, memory, subject)
        return await self._publish(subject, found, memory)

    def news(self, name: Name, manifest: Manifest) -> bool:
        """Returns whether an event carries anything that the last pass has not read or written itself."""
        memory = self.memories.get(name)
        metadata = manifest["metadata"]
        return memory is None or memory.versions.get(metadata["uid"]) != metadata.get("resourceVersion")

    def saw_lease(self, name: Name, lease: Manifest) -> float | None:
        """Notes that a robot's Lease has moved.

        Returns the seconds until the next pass, or None if one is needed now.
        """
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

    def _note_failure(self, error: Exception, found: _Findings, memory: Memory, subject: Subject) -> None:
        """Turns what broke a step off into a verdict.

        Raises:
            KubeError: the API server is in passing trouble, and has not been for long.
        """
        memory.failures += 1
        if isinstance(error, KubeError) and error.retriable and memory.failures <= PATIENCE:
            raise error
        found.verdicts["ResourcesApplied"] = verdict_of(error, found.step)
        found.broken = True
        _log.error("A step broke", **subject.words, step=found.step.value, exc_info=error)

    async def _publish(self, subject: Subject, found: _Findings, memory: Memory) -> Result:
        before = subject.status
        after = status.build(
            before, subject.generation, found.verdicts, self._clock.wall(), found.offload, found.status
        )
        writes = await publish(self._api, subject.raw, after, memory, self._clock)
        memory.versions |= found.versions
        if not found.broken:
            memory.failures = 0
        return Result(found.again_s, self._worth_a_retry(found, memory), found.applied.writes + writes)

    @staticmethod
    def _worth_a_retry(found: _Findings, memory: Memory) -> bool:
        """Returns whether trying again soon may help: not when the same was refused for good twice in a row."""
        errors = found.applied.errors
        before, memory.refusals = memory.refusals, frozenset(map(str, errors))
        if found.broken or any(error.retriable for error in errors):
            return True
        return bool(errors) and memory.refusals != before


async def render(parent: Parent) -> tuple[Manifest, ...]:
    """Renders the children in a thread: leadership and probes never wait for what a user wrote.

    Raises:
        RenderTimeoutError: it took longer than `RENDER_S`.
    """
    try:
        async with asyncio.timeout(RENDER_S):
            return await asyncio.to_thread(children, parent)
    except TimeoutError as error:
        raise RenderTimeoutError(
            f"the objects were not worked out within {RENDER_S:g} s; make the parameter files smaller, or give the "
            "operator more CPU"
        ) from error


class RenderTimeoutError(RobotOffloadError):
    """Rendering one RobotOffload takes too long."""


class _Findings:
    """What a pass finds out for the status and for the queue, however far it comes.

    Attributes:
        step: which step is under way.
        verdicts: by type of condition.
        applied: what became of all writes so far.
        offload: the RobotOffload, once it is known as valid.
        status: what is known beside the conditions; None: the cluster could not be read to the end.
        versions: resourceVersions of the children by uid.
        again_s: seconds after which time alone may change something; None: never.
        broken: whether a step was broken off.
    """

    def __init__(self) -> None:
        self.step = Step.READ
        self.verdicts: dict[str, Verdict] = {}
        self.applied = Applied()
        self.offload: RobotOffload | None = None
        self.status: status.Found | None = None
        self.versions: dict[str, str] = {}
        self.again_s: float | None = None
        self.broken = False


class _Pass:
    """One pass over a valid RobotOffload."""

    def __init__(
        self,
        api: KubeApi,
        images: Images,
        clock: Clock,
        subject: Subject,
        offload: RobotOffload,
        memory: Memory,
        found: _Findings,
    ) -> None:
        self._api = api
        self._images = images
        self._clock = clock
        self._subject = subject
        self._offload = offload
        self._memory = memory
        self._found = found
        self._snapshot = observe.Snapshot()

    async def run(self) -> None:
        """Observes, decides and applies; what is found out goes to the findings as soon as it is known."""
        found, spec = self._found, self._offload.spec
        found.offload = self._offload

        found.step = Step.OBSERVE
        self._memory.config_maps = frozenset(name for name, _ in observe.config_maps(self._offload))
        self._snapshot = await observe.cluster(self._api, self._subject.namespace, self._offload)
        lease = self._snapshot.ours(LEASE, child_name(self._subject.name, ROBOT), self._subject.uid)
        robot = self._robot(lease)
        wanted = presence.wanted(spec, robot, self._clock.wall())
        parent = Parent(self._offload, self._facts(robot, wanted))

        found.step = Step.SECRETS  # the first wave
        secrets = await self._secrets(parent)
        found.verdicts["CertificatesReady"] = secrets.verdict

        found.step = Step.BUILDS
        built = await self._builds(parent)
        found.verdicts["ImageBuilt"] = built.verdict

        found.step = Step.DISCOVERY  # the second wave
        servers = await self._discovery(parent)

        found.step = Step.RENDER
        facts = replace(
            parent.facts, certificate_hash=secrets.hash, built=built.references, discovery_hosts=servers.hosts
        )
        manifests = (*secrets.issuer, *built.manifests, *await render(Parent(self._offload, facts)))
        rest = [manifest for manifest in manifests if key_of(manifest) not in servers.keys]

        found.step = Step.APPLY  # the third wave: everything else, and what is not wanted any more goes
        prunable = self._prunable(secrets.kept | built.kept | servers.keys) if servers.known else frozenset()
        await self._apply(rest, prunable)
        found.verdicts["ResourcesApplied"] = found.applied.verdict

        found.step = Step.JUDGE
        await self._judge(robot, wanted, built, lease)
        found.versions = self._snapshot.versions
        times = (robot.recheck_s, wanted.recheck_s, secrets.recheck_s, built.recheck_s, found.applied.recheck_s)
        found.again_s = min((after_s for after_s in times if after_s is not None), default=None)

    def _robot(self, lease: Manifest | None) -> presence.Presence:
        """Returns the robot's presence; its Lease counts only when it is ours."""
        now_s = self._clock.steady_s()
        self._memory.lease = presence.meaning(lease) if lease is not None else None
        self._memory.sighting = presence.look(self._memory.sighting, lease, now_s)
        before = self._subject.status.get("robot") or {}
        return presence.presence(lease, self._memory.sighting, before, now_s, self._clock.wall())

    def _facts(self, robot: presence.Presence, wanted: presence.Wanted) -> Facts:
        return Facts(
            namespace=self._subject.namespace,
            uid=self._subject.uid,
            generation=self._subject.generation,
            images=self._images,
            nodes_wanted=wanted.nodes,
            robot_connected=robot.connected,
            endpoints=self._endpoints(),
            user_config_hashes=self._snapshot.config_hashes,
            user_configs=self._snapshot.config_texts,
        )

    def _endpoints(self) -> tuple[Endpoint, ...]:
        services = self._snapshot.services(self._subject.uid)
        return transport.observed_endpoints(self._offload, services, self._snapshot.nodes)

    async def _secrets(self, parent: Parent) -> _Secrets:
        """Brings the Secrets with certificates up to date before anything reads them."""
        if not transport.needs_certificates(parent.spec):
            return _Secrets(yes("NotNeeded", "This transport uses no certificates"))
        keys = certificates.secret_keys(parent.name)
        await observe.look_up(self._api, self._subject.namespace, self._snapshot, keys.values())
        live = {role: self._snapshot.ours(*key, self._subject.uid) for role, key in keys.items()}
        if parent.spec.transport.certificates.issuer_ref is not None:
            # The authorities are not ours then, and the leaves are cert-manager's.
            leaves = frozenset({keys["cloud"], keys["robot"]})
            content = certificates.content_hash(live["cloud"])
            return _Secrets(issuer.verdict(live), leaves, content, issuer=issuer.certificates(parent))
        revoke = self._subject.annotation(certificates.REVOKE)
        issued = certificates.issue(parent, live, revoke, self._clock.wall())
        for role, why in issued.made:
            _log.info("Made certificate", **self._subject.words, role=role, reason=why.reason)
        applied = await self._apply(issued.secrets)
        content = certificates.content_hash(self._snapshot.ours(*keys["cloud"], self._subject.uid))
        verdict = issued.verdict if applied.complete else applied.verdict
        return _Secrets(verdict, frozenset(keys.values()), content, issued.recheck_s if applied.complete else None)

    async def _builds(self, parent: Parent) -> builds.Builds:
        """Decides about the images that are built here; what there is of them is only read when there are any."""
        if not parent.spec.built_nodes:
            return builds.Builds()
        pods = await observe.build_pods(self._api, self._subject.namespace, self._offload)
        secrets = builds.secrets_of(self._offload)
        types = await observe.secret_types(self._api, self._subject.namespace, secrets)
        before = builds.Before(self._snapshot.live, pods, secrets - types.keys(), self._clock.wall(), types)
        return builds.decide(parent, before, self._subject.annotation(builds.REBUILD))

    async def _discovery(self, parent: Parent) -> _Servers:
        """Applies the Services of the discovery servers before anything needs their addresses."""
        if not transport.discovery_servers(parent.spec):
            return _Servers()
        names = set(discovery.names(self._offload))
        services = transport.of(parent.spec).services(parent)
        wanted = [service for service in services if service["metadata"]["name"] in names]
        keys = frozenset(map(key_of, wanted))
        await self._apply(wanted)
        ours = [self._snapshot.ours(*key, self._subject.uid) for key in keys]
        hosts = discovery.hosts(self._offload, [service for service in ours if service is not None])
        # Without them what is there goes on as it is: it must not be pruned because it cannot be rendered now.
        return _Servers(keys, hosts, known=bool(hosts))

    def _prunable(self, kept: frozenset[Key]) -> frozenset[Key]:
        """Returns which children may go when they are not wanted: all that this pass has not dealt with otherwise."""
        return frozenset(self._snapshot.live) - kept

    async def _apply(self, wanted: Iterable[Manifest], prunable: Iterable[Key] = ()) -> Applied:
        """Applies children in their order, then prunes."""
        manifests, live, uid = list(wanted), self._snapshot.live, self._subject.uid
        await observe.look_up(self._api, self._subject.namespace, self._snapshot, map(key_of, manifests))
        now_s = self._clock.steady_s()
        steps = plan(manifests, live, uid, prunable=prunable, history=self._memory.history, now_s=now_s)
        applied = await carry_out(self._api, steps, live, self._memory.history, self._clock)
        self._found.applied.add(applied)
        if applied.writes:
            _log.info("Applied", **self._subject.words, writes=applied.writes, errors=len(applied.errors))
        return applied

    async def _judge(
        self, robot: presence.Presence, wanted: presence.Wanted, built: builds.Builds, lease: Manifest | None
    ) -> None:
        """Works out from what is live now the rest of the status and the conditions that follow."""
        uid, generation = self._subject.uid, self._subject.generation
        pods: tuple[Manifest, ...] = ()
        if not all(workloads.workload(child).holds for child in self._snapshot.workloads(uid)):
            pods = await observe.pods(self._api, self._subject.namespace, self._offload)
        state, problem = agent.state_of(lease)
        self._found.status = status.Found(
            robot=robot,
            robot_generation=state.settings.robot_generation if state is not None else None,
            placement=agent.placement(state, problem, connected=robot.connected),
            endpoints=self._endpoints(),
            wanted=wanted,
            live=self._snapshot.children(uid),
            pods=pods,
            commits={node: image.commit for node, image in built.images.items()},
        )
        self._found.verdicts |= {
            **workloads.conditions(self._offload, self._found.status.live, pods, wanted.nodes, wanted.verdict),
            "Connected": robot.verdict,
            "ConfigCurrent": agent.config_current(state, generation, connected=robot.connected),
        }


@dataclass(frozen=True, slots=True)
class _Secrets:
    """What the first wave has led to.

    Attributes:
        verdict: for the condition CertificatesReady.
        kept: Secrets that the third wave leaves alone.
        hash: of the cloud's certificate; empty: there is none.
        recheck_s: seconds until one of them is to be renewed; None: never.
        issuer: objects that ask the user's own issuer for certificates.
    """

    verdict: Verdict
    kept: frozenset[Key] = frozenset()
    hash: str = ""
    recheck_s: float | None = None
    issuer: tuple[Manifest, ...] = ()


@dataclass(frozen=True, slots=True)
class _Servers:
    """What the second wave has led to.

    Attributes:
        keys: the Services of the discovery servers.
        hosts: their addresses; empty: not known, or not needed.
        known: whether all addresses that are needed are known.
    """

    keys: frozenset[Key] = frozenset()
    hosts: tuple[str, ...] = ()
    known: bool = True
