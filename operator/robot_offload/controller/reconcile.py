"""The five steps for one RobotOffload: load -> observe -> desired -> apply -> publish.

Level-triggered: any event calls `Controller.reconcile` with a name, which reads everything anew. It may be called at
any time and any number of times; a crash between two of its writes is repaired by the next call. Every pass computes
the status, whatever failed before, and writes it only if it differs.

Children are applied in three waves, because each needs the results of the one before: the Secrets with certificates,
the Services of the discovery servers, the rest.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final, TypeAlias

import structlog

from robot_offload.api.v1alpha1 import RobotOffload, pinned
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, check
from robot_offload.controller.admission import Admission, NotAdmittedError
from robot_offload.controller.clock import Clock
from robot_offload.controller.failures import verdict_of
from robot_offload.controller.memory import Memory, summary
from robot_offload.controller.publish import Post, publish
from robot_offload.controller.steps import Findings, Pass
from robot_offload.controller.store import Store
from robot_offload.controller.subject import Subject
from robot_offload.controller.tools import Policy, Tools
from robot_offload.decide import authorities, conditions, neighbours, presence, rollouts, status
from robot_offload.decide.ownership import being_deleted
from robot_offload.errors import InputError, SpecError
from robot_offload.findings import Finding
from robot_offload.kube.errors import KubeError, NotLeaderError
from robot_offload.kube.kinds import DEPLOYMENT, LEASE, ROBOT_OFFLOAD, SECRET, STATEFUL_SET
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects.facts import Images
from robot_offload.objects.names import ROBOT, child_name

Name: TypeAlias = tuple[str, str]
"""Namespace and name of a RobotOffload."""
DEFAULTS: Final = Policy()
PATIENCE: Final = 3
"""Passes in a row that a transient API server failure may end before the status reports it."""
_log = structlog.get_logger("robot_offload.controller")


@dataclass(frozen=True, slots=True)
class Result:
    """What follows a pass.

    Attributes:
        again_s: seconds after which to look again without an event; None: only on events.
        failed: whether to retry soon, with growing pauses.
        writes: how many writes it made, the status included.
    """

    again_s: float | None = None
    failed: bool = False
    writes: int = 0


class Controller:
    """Keeps every RobotOffload as declared."""

    def __init__(
        self,
        api: KubeApi,
        images: Images,
        clock: Clock | None = None,
        store: Store | None = None,
        policy: Policy = DEFAULTS,
        post: Post = lambda _offload, _transition: None,
    ) -> None:
        """Create a controller; `post` posts Events."""
        self._post = post
        known = Store() if store is None else store
        budget: rollouts.Budget[Name] = rollouts.Budget(policy.max_rolling)
        self._tools = Tools(api, known, images, clock or Clock(), policy, budget)
        self._admission = Admission(api, self._tools.clock, policy.admission)
        self.memories: dict[Name, Memory] = {}
        self._readers: dict[tuple[str, str], set[Name]] = {}

    async def reconcile(self, name: Name) -> Result:
        """Make one pass. Calls for the same name must not overlap; the queue ensures that."""
        raw = await self._load(name)
        if raw is None:
            return Result()
        memory = self._memory(name, raw)
        memory.status = summary(raw.get("status") or {})
        subject = Subject(raw)
        based_on = self._based_on(name, raw, memory)
        left_s = memory.due_s - self._tools.clock.steady_s()
        if based_on is not None and memory.unchanged == based_on and left_s > 0:
            return Result(again_s=None if math.isinf(left_s) else left_s)
        found = Findings()
        try:
            offload = parse_object(raw, "/".join(name), unknown="ignore", rules=CLUSTER_CHECKS)
            await self._admission.check(raw, offload, "/".join(name))
            warnings = (
                *check(offload.spec, CLUSTER_CHECKS),
                *pinned.findings(offload),
                *self._neighbours(offload, name),
            )
            found.verdicts["SpecValid"] = conditions.spec_valid((), warnings)
            await Pass(self._tools, subject, offload, memory, found).run()
        except SpecError as error:
            # Every problem is reported, nothing is changed, and the next pass waits for a change.
            found.verdicts["SpecValid"] = conditions.spec_valid(error.findings)
            found.watchless = isinstance(error, NotAdmittedError)
        except NotLeaderError:
            raise
        except Exception as error:
            self._note_failure(error, found, memory, subject)
        result = await self._publish(subject, found, memory)
        for config in memory.configs:
            self._readers.setdefault((name[0], config), set()).add(name)
        quiet = not (result.writes or result.failed or found.watchless)
        memory.unchanged = based_on if quiet else None
        now_s = self._tools.clock.steady_s()
        memory.due_s = math.inf if result.again_s is None else now_s + result.again_s
        memory.however_s = math.inf if found.however_s is None else now_s + found.however_s
        return result

    async def preread(self, served: Collection[str]) -> None:
        """Read the certificates of all RobotOffloads in the complete store, in a few lists.

        Args:
            served: namespaces whose RobotOffloads this operator serves; empty: all.
        """
        try:
            await self._tools.preread.read(self._tools.api, self._tools.store, served, self._tools.policy.home)
        except KubeError as error:
            _log.warning("Reads certificates one by one", error=str(error))

    def forget_preread(self) -> None:
        """Drop the Secrets that no pass has taken."""
        self._tools.preread.forget()

    def resume(self) -> None:
        """Find in the complete store the robots whose pods an earlier operator began to replace."""
        store = self._tools.store
        rolling = store.owners((DEPLOYMENT, STATEFUL_SET), rollouts.under_way)
        alone = store.named(ROBOT_OFFLOAD, lambda raw: (raw.get("status") or {}).get("placement") != "Cloud")
        self._tools.budget.resume(rolling, self._tools.clock.steady_s(), alone)

    def readers(self, namespace: str, config_map: str) -> frozenset[Name]:
        """Return the RobotOffloads whose nodes read a user's ConfigMap."""
        found = self._readers.get((namespace, config_map), set())
        found -= {name for name in found if config_map not in self._configs_of(name)}
        return frozenset(found)

    def _neighbours(self, offload: RobotOffload, name: Name) -> Iterable[Finding]:
        """Return warnings about other RobotOffloads of the namespace; none before the store knows them."""
        if not neighbours.matter(offload):
            return ()
        entries = self._tools.store.entries(ROBOT_OFFLOAD, name[0])[: neighbours.COMPARED]
        return neighbours.findings(offload, [entry.manifest() for _, entry in entries])

    def _configs_of(self, name: Name) -> Iterable[str]:
        memory = self.memories.get(name)
        return () if memory is None else memory.configs

    def _based_on(self, name: Name, raw: Manifest, memory: Memory) -> object:
        """Return all inputs of a pass; equal inputs give equal results. None: the store does not know."""
        if not self._tools.store.fed:
            return None
        configs = tuple(
            (config, self._tools.store.config_versions.get((name[0], config))) for config in sorted(memory.configs)
        )
        versions = self._tools.store.versions(*name, without=(LEASE,))
        home = self._tools.policy.home
        signing = tuple(
            (secret, None if entry is None else (entry.uid, entry.version))
            for secret in authorities.secret_names(raw["metadata"]["uid"]).values()
            for entry in (self._tools.store.entry(SECRET, home, secret),)
        )
        # The Lease moves every few seconds; only its other content counts.
        lease = self._tools.store.get(LEASE, name[0], child_name(name[1], ROBOT))
        said = None if lease is None else str(presence.meaning(lease))
        # While a robot is away each move of its Lease may be its return; after the operator's start the first one is.
        connected = (memory.status.get("robot") or {}).get("connected")
        seen = memory.sighting.first if memory.sighting and connected else memory.sighting
        return raw["metadata"]["resourceVersion"], versions, signing, configs, said, seen

    def saw_lease(self, name: Name, lease: Manifest) -> float | None:
        """Record that a robot's Lease has moved.

        Return the seconds for which no pass is needed, or None if one is needed now. While a robot keeps renewing,
        only the moment at which it counts as gone is put off.
        """
        memory = self.memories.get(name)
        if memory is None or memory.sighting is None or memory.lease is None:
            return None
        memory.sighting = presence.look(memory.sighting, lease, self._tools.clock.steady_s())
        if presence.meaning(lease) != memory.lease or memory.sighting.first:
            return None
        if not (memory.status.get("robot") or {}).get("connected"):
            return None
        left_s = memory.however_s - self._tools.clock.steady_s()
        return max(0.0, min(presence.duration_s(lease), left_s))

    async def _load(self, name: Name) -> Manifest | None:
        if self._tools.store.fed:
            raw = self._tools.store.get(ROBOT_OFFLOAD, *name)
        else:
            raw = await self._tools.api.get(ROBOT_OFFLOAD, *name)
        if raw is None:
            self.memories.pop(name, None)
            self._tools.budget.done(name)
            return None
        # While it is being deleted nothing is created: owner references do the rest.
        return None if being_deleted(raw) else raw

    def _memory(self, name: Name, raw: Manifest) -> Memory:
        uid = raw["metadata"]["uid"]
        memory = self.memories.get(name)
        if memory is None or memory.uid != uid:
            memory = self.memories[name] = Memory(uid)
        return memory

    def _note_failure(self, error: Exception, found: Findings, memory: Memory, subject: Subject) -> None:
        """Turn the error that ended a step into a verdict.

        Raises:
            KubeError: the API server has failed, transiently and only recently.
        """
        memory.failures += 1
        if isinstance(error, KubeError) and error.retriable and memory.failures <= PATIENCE:
            raise error
        found.verdicts["ResourcesApplied"] = verdict_of(error, found.step)
        if isinstance(error, InputError):
            # Only a change can help, and the watches bring it.
            _log.warning("Cannot render", **subject.words, error=str(error))
            return
        found.broken = True
        _log.error("A step broke", **subject.words, step=found.step.value, exc_info=error)

    async def _publish(self, subject: Subject, found: Findings, memory: Memory) -> Result:
        before = subject.status
        after = status.build(
            before, subject.generation, found.verdicts, self._tools.clock.wall(), found.offload, found.status
        )
        tools = self._tools
        writes = await publish(tools.api, tools.store, subject.raw, after, memory, tools.clock, self._post)
        if not found.broken:
            memory.failures = 0
        return Result(found.again_s, self._worth_a_retry(found, memory), found.applied.writes + writes)

    @staticmethod
    def _worth_a_retry(found: Findings, memory: Memory) -> bool:
        """Return whether an early retry may help: not if the same was refused for good twice in a row."""
        errors = found.applied.errors
        before, memory.refusals = memory.refusals, frozenset(map(str, errors))
        if found.broken or any(error.retriable for error in errors):
            return True
        return bool(errors) and memory.refusals != before
