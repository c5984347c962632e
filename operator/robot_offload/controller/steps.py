"""The steps of one pass over a valid RobotOffload, in their order."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import structlog

from robot_offload import transport
from robot_offload.api.agent_state import AgentState
from robot_offload.api.v1alpha1 import RobotOffload, pinned
from robot_offload.controller import observe
from robot_offload.controller.apply import Applied, carry_out
from robot_offload.controller.authorities import Authorities
from robot_offload.controller.certify import Certifying, Secrets, judge
from robot_offload.controller.failures import Step
from robot_offload.controller.memory import Memory
from robot_offload.controller.subject import Subject
from robot_offload.controller.tools import Tools
from robot_offload.decide import (
    addresses,
    agent,
    authors,
    builds,
    presence,
    presented,
    rollouts,
    status,
    trail,
    workloads,
)
from robot_offload.decide.ownership import Key, key_of
from robot_offload.decide.plan import Plan, plan
from robot_offload.decide.verdicts import Verdict
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.kinds import JOB, LEASE
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Facts
from robot_offload.objects.names import ROBOT, child_name
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from robot_offload.transport import discovery

RENDER_S: Final = 20.0
"""Seconds after which a rendering is abandoned. 64 nodes with the largest parameter files take less than two."""
LOOK_AGAIN_S: Final = 15.0
"""Seconds after which to ask again why a workload has no pods."""
_log = structlog.get_logger("robot_offload.controller")


async def render(parent: Parent) -> tuple[Manifest, ...]:
    """Render the children in a thread, so that leadership and probes never wait for a user's input.

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


class Findings:
    """What a pass finds out for the status and for the queue, even if it fails.

    Attributes:
        verdicts: by type of condition.
        applied: the result of all writes so far.
        offload: the RobotOffload, once it is known to be valid.
        status: what is known beside the conditions; None: the cluster could not be read completely.
        watchless: whether something without a watch was read: the same versions may then have another meaning.
        again_s: seconds after which time alone may change something; None: never.
        however_s: the same, whether or not the robot's Lease moves meanwhile.
        broken: whether a step failed.
        step: the present step.
    """

    def __init__(self) -> None:
        self.step = Step.READ
        self.verdicts: dict[str, Verdict] = {}
        self.applied = Applied()
        self.offload: RobotOffload | None = None
        self.status: status.Found | None = None
        self.watchless = False
        self.again_s: float | None = None
        self.however_s: float | None = None
        self.broken = False


class Pass:
    """One pass over a valid RobotOffload."""

    def __init__(
        self,
        tools: Tools,
        subject: Subject,
        offload: RobotOffload,
        memory: Memory,
        found: Findings,
    ) -> None:
        self._tools = tools
        self._api = tools.api
        self._store = tools.store
        self._images = tools.images
        self._clock = tools.clock
        self._policy = tools.policy
        self._budget = tools.budget
        self._observer = observe.Observer(tools.api, tools.store, subject.namespace, offload)
        self._subject = subject
        self._hold = pinned.hold(
            offload.spec.switching.pin,
            subject.annotation(pinned.PINNED_UNTIL),
            str((subject.status.get("pin") or {}).get("ended") or ""),
            tools.clock.wall(),
        )
        self._offload = pinned.held(offload, self._hold.side)
        self._memory = memory
        self._found = found
        self._snapshot = observe.Snapshot()
        self._audit_s: float | None = None
        self._refused_s: float | None = None

    async def run(self) -> None:
        """Observe, decide and apply; record each finding as soon as it is known."""
        found, spec = self._found, self._offload.spec
        found.offload = self._offload

        found.step = Step.OBSERVE
        expose = spec.transport.expose
        by_nodes = expose.type == "NodePort" and not expose.host
        found.watchless = by_nodes or spec.transport.certificates.issuer_ref is not None
        self._snapshot = await self._observer.cluster(self._memory.configs)
        lease = self._snapshot.ours(LEASE, child_name(self._subject.name, ROBOT), self._subject.uid)
        robot = self._robot(lease)
        wanted = presence.wanted(spec, robot, self._clock.wall())
        parent = Parent(self._offload, self._facts(robot, wanted))

        found.step = Step.SECRETS  # the first wave
        state, problem = agent.state_of(lease)
        seen = (self._tools, self._subject, self._memory, self._observer, self._snapshot)
        authorities = Authorities(*seen, self._note)
        secrets = await Certifying(*seen, self._apply, authorities).run(parent, state)
        found.verdicts["CertificatesReady"] = secrets.verdict

        found.step = Step.BUILDS
        built = await self._builds(parent)
        found.verdicts["ImageBuilt"] = built.verdict

        found.step = Step.DISCOVERY  # the second wave
        servers = await self._discovery(parent)

        found.step = Step.RENDER
        facts = replace(
            parent.facts,
            identity=authorities.identity(),
            certificate_hash=secrets.hash,
            certificate_answer=secrets.answer.text() if secrets.answer is not None else "",
            built=built.references,
            discovery_hosts=servers.hosts,
        )
        manifests = (*secrets.issuer, *built.manifests, *await render(Parent(self._offload, facts)))
        rest = [manifest for manifest in manifests if key_of(manifest) not in servers.keys]

        found.step = Step.APPLY  # the third wave: everything else; what is no longer wanted is deleted
        prunable = self._prunable(secrets.kept | built.kept | servers.keys) if servers.known else frozenset()
        await self._apply(rest, prunable)
        found.verdicts["ResourcesApplied"] = found.applied.verdict

        found.step = Step.JUDGE
        await self._judge(robot, wanted, built, state, problem)
        shown = self._judge_certificates(secrets, state)
        ours = (self._hold.recheck_s, self._audit_s, self._refused_s)
        times = (wanted.recheck_s, secrets.recheck_s, shown, built.recheck_s, found.applied.recheck_s, *ours)
        found.however_s = min((after_s for after_s in times if after_s is not None), default=None)
        either = (found.however_s, robot.recheck_s)
        found.again_s = min((after_s for after_s in either if after_s is not None), default=None)

    def _robot(self, lease: Manifest | None) -> presence.Presence:
        """Return the robot's presence; its Lease counts only if it is ours."""
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
            load_balancer_node_ports=self._policy.load_balancer_node_ports,
            network=self._policy.network,
            pull_secrets=self._policy.pull_secrets,
            pod_spec=self._policy.pod_spec,
            home=self._policy.home,
            author=authors.author(self._subject.raw["metadata"], self._hold),
        )

    def _endpoints(self) -> tuple[Endpoint, ...]:
        services = self._snapshot.services(self._subject.uid)
        return transport.observed_endpoints(self._offload, services, self._snapshot.nodes)

    def _judge_certificates(self, secrets: Secrets, state: AgentState | None) -> float | None:
        """Add the judgement of the certificates; return the seconds after which it changes without an event."""
        assert self._found.status is not None
        before = (self._subject.status.get("certificates") or {}).get("robot") or {}
        judged = judge(self._offload, secrets, presented.presented(state, before), self._clock.wall())
        self._found.verdicts["CertificateCurrent"] = judged.verdict
        self._found.status = replace(self._found.status, certificates=judged.shown)
        return judged.recheck_s

    async def _builds(self, parent: Parent) -> builds.Builds:
        """Decide about the images that are built here; read their state only if there are any."""
        if not parent.spec.built_nodes:
            return builds.Builds()
        pods = await self._observer.build_pods()
        waiting = [job for (kind, _), job in self._snapshot.live.items() if kind == JOB and workloads.podless(job)]
        refusals = {name: words for (_, name), words in (await self._observer.refusals(waiting)).items()}
        secrets = builds.secrets_of(self._offload)
        types = await self._observer.secret_types(secrets)
        before = builds.Before(self._snapshot.live, pods, secrets - types.keys(), self._clock.wall(), types, refusals)
        return builds.decide(parent, before, self._subject.annotation(builds.REBUILD))

    async def _discovery(self, parent: Parent) -> _Servers:
        """Apply the Services of the discovery servers before their addresses are needed."""
        if not transport.discovery_servers(parent.spec):
            return _Servers()
        names = set(discovery.names(self._offload))
        services = transport.of(parent.spec).services(parent)
        wanted = [service for service in services if service["metadata"]["name"] in names]
        keys = frozenset(map(key_of, wanted))
        await self._apply(wanted)
        ours = [self._snapshot.ours(*key, self._subject.uid) for key in keys]
        hosts = discovery.hosts(self._offload, [service for service in ours if service is not None])
        # Without them existing children stay as they are: they must not be pruned because they cannot be rendered now.
        return _Servers(keys, hosts, known=bool(hosts))

    def _prunable(self, kept: frozenset[Key]) -> frozenset[Key]:
        """Return the children that may be deleted if not wanted: all that this pass has not handled otherwise."""
        return frozenset(self._snapshot.live) - kept

    async def _apply(self, wanted: Iterable[Manifest], prunable: Iterable[Key] = ()) -> Applied:
        """Apply children in their order, then prune."""
        manifests, live, uid = list(wanted), self._snapshot.live, self._subject.uid
        history, now_s, may_go = self._memory.history, self._clock.steady_s(), frozenset(prunable)
        steps = plan(manifests, live, uid, prunable=may_go, history=history, now_s=now_s)
        if steps.doubtful:
            await self._observer.confirm(self._snapshot, steps.doubtful)
            steps = plan(manifests, live, uid, prunable=may_go, history=history, now_s=now_s)
            steps = self._in_turn(steps)
        applied = await carry_out(self._api, self._store, steps, live, history, self._clock)
        self._note(applied)
        return applied

    def _note(self, applied: Applied) -> None:
        """Record the result of writes, for the status and for the log."""
        self._found.applied.add(applied)
        if applied.writes:
            _log.info("Applied", **self._subject.words, writes=applied.writes)
        for error in applied.errors:
            _log.warning("Refused", **self._subject.words, reason=error.reason, error=str(error))

    def _in_turn(self, steps: Plan) -> Plan:
        """Leave out what would replace too many pods at once. A person's latest change does not wait."""
        live = self._snapshot.live
        steps = rollouts.in_turn(steps, live)
        changed = self._subject.generation != self._subject.status.get("observedGeneration")
        if changed or not any(rollouts.rolls(step, live) for step in steps.applies):
            return steps
        cloud_acts = self._subject.status.get("placement") == "Cloud"
        name = (self._subject.namespace, self._subject.name)
        may = self._budget.may_roll(name, self._clock.steady_s(), cloud_acts=cloud_acts)
        return steps if may else rollouts.held_back(steps, live)

    async def _judge(
        self,
        robot: presence.Presence,
        wanted: presence.Wanted,
        built: builds.Builds,
        state: AgentState | None,
        problem: str,
    ) -> None:
        """Work out the rest of the status, and its conditions, from the live objects."""
        uid, generation = self._subject.uid, self._subject.generation
        pods: tuple[Manifest, ...] = ()
        refusals: dict[Key, str] = {}
        if all(workloads.workload(child).holds for child in self._snapshot.workloads(uid)):
            if not any(one.reason == rollouts.WAITING for one in self._found.applied.obstacles):
                self._budget.done((self._subject.namespace, self._subject.name))
        else:
            pods = await self._observer.pods()
            waiting = [child for child in self._snapshot.workloads(uid) if workloads.podless(child)]
            refusals = await self._observer.refusals(waiting)
            # No watch brings the event that gives the reason.
            self._refused_s = LOOK_AGAIN_S if waiting else None
        dials = agent.dialled(state, self._subject.status.get("robot") or {})
        endpoints = self._endpoints()
        before = self._subject.status.get("audit") or {}
        audit, self._audit_s = trail.shown(state.audit if state is not None else "", before, self._clock.wall())
        self._found.status = status.Found(
            robot=robot,
            dials=dials,
            robot_generation=state.settings.robot_generation if state is not None else None,
            placement=agent.placement(state, problem, connected=robot.connected),
            endpoints=endpoints,
            wanted=wanted,
            live=self._snapshot.children(uid),
            pods=pods,
            commits={node: image.commit for node, image in built.images.items()},
            hold=self._hold,
            audit=audit,
        )
        self._found.verdicts |= {
            **workloads.conditions(
                self._offload, self._found.status.live, pods, wanted.nodes, wanted.verdict, refusals
            ),
            "AddressesReady": addresses.addresses_ready(self._offload, endpoints),
            "Connected": robot.verdict,
            "ConfigCurrent": agent.config_current(
                state, generation, connected=robot.connected, dials=dials, endpoints=endpoints
            ),
        }


@dataclass(frozen=True, slots=True)
class _Servers:
    """The result of the second wave.

    Attributes:
        keys: the Services of the discovery servers.
        hosts: their addresses; empty: not known, or not needed.
        known: whether all needed addresses are known.
    """

    keys: frozenset[Key] = frozenset()
    hosts: tuple[str, ...] = ()
    known: bool = True
