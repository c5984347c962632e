"""The first wave of a pass: the Secrets with certificates, brought up to date before anything reads them."""

from __future__ import annotations

import datetime
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import structlog

from robot_offload import transport
from robot_offload.api.agent_state import AgentState
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.controller.apply import Applied
from robot_offload.controller.authorities import Authorities
from robot_offload.controller.memory import Certified, Memory
from robot_offload.controller.observe import Observer, Snapshot
from robot_offload.controller.subject import Subject
from robot_offload.controller.tools import Tools
from robot_offload.decide import certificates, issuer, presented
from robot_offload.decide.authorities import AUTHORITIES
from robot_offload.decide.ownership import Key, key_of
from robot_offload.decide.plan import plan
from robot_offload.decide.renewal import Answer
from robot_offload.decide.verdicts import Verdict, yes
from robot_offload.kube.port import Manifest
from robot_offload.objects.parent import Parent

Apply: TypeAlias = Callable[[Iterable[Manifest]], Awaitable[Applied]]
_log = structlog.get_logger("robot_offload.controller")


@dataclass(frozen=True, slots=True)
class Secrets:
    """The result of the first wave.

    Attributes:
        verdict: for the condition CertificatesReady.
        kept: Secrets that the third wave must not change.
        hash: of the cloud's certificate; empty: it does not exist.
        recheck_s: seconds until the first renewal; None: never.
        issuer: objects that request certificates from the user's own issuer.
        answer: to the robot's request for a certificate; None: there is no request.
        ends: serial numbers and ends of the leaves, as in the status.
    """

    verdict: Verdict
    kept: frozenset[Key] = frozenset()
    hash: str = ""
    recheck_s: float | None = None
    issuer: tuple[Manifest, ...] = ()
    answer: Answer | None = None
    ends: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


class Certifying:
    """The first wave of one pass.

    Args:
        tools: shared by all passes.
        subject: of the pass.
        memory: of the subject.
        observer: reads for this pass.
        snapshot: what was read.
        apply: writes beside the robot.
        authorities: reads and writes the authorities' keys, in the operator's namespace.
    """

    def __init__(
        self,
        tools: Tools,
        subject: Subject,
        memory: Memory,
        observer: Observer,
        snapshot: Snapshot,
        apply: Apply,
        authorities: Authorities,
    ) -> None:
        self._store = tools.store
        self._preread = tools.preread
        self._clock = tools.clock
        self._subject = subject
        self._memory = memory
        self._observer = observer
        self._snapshot = snapshot
        self._apply = apply
        self._authorities = authorities

    async def run(self, parent: Parent, state: AgentState | None) -> Secrets:
        """Bring the Secrets up to date; `state` is that of the cloud's agent."""
        keys = certificates.secret_keys(parent.name)
        kept = await self._authorities.take_over(parent) | frozenset(keys.values())
        if not transport.needs_certificates(parent.spec):
            # The bundles of robots stay valid while the user tries another transport.
            return Secrets(yes("NotNeeded", "This transport uses no certificates"), kept)
        revoke = self._subject.annotation(certificates.REVOKE)
        asked = state.certificate.request if state is not None else ""
        based_on = self._based_on(keys.values(), revoke, asked)
        known, now_s = self._memory.secrets, self._clock.steady_s()
        if known is not None and based_on is not None and known.based_on == based_on and now_s < known.renewal_s:
            left_s = known.renewal_s - now_s
            return Secrets(known.verdict, kept, known.hash, left_s, answer=known.answer, ends=known.ends)
        found = self._as_preread(parent, asked)
        if found is not None:
            return self._noted(found, asked, kept)
        await self._observer.confirm(self._snapshot, keys.values())
        leaves: dict[certificates.Role, Manifest | None] = {
            role: self._snapshot.ours(*key, self._subject.uid) for role, key in keys.items()
        }
        if parent.spec.transport.certificates.issuer_ref is not None:
            # The leaves are then cert-manager's; our authorities stay, as the user may only be trying an issuer.
            content = certificates.content_hash(leaves["cloud"])
            return Secrets(
                issuer.verdict(leaves),
                kept,
                content,
                issuer=issuer.certificates(parent),
                answer=issuer.answer(asked) if asked else None,
                ends=_ends(leaves),
            )
        signing = await self._authorities.read()
        if not any(signing.values()) and await self._authorities.adopt(parent):
            signing = await self._authorities.read()
        live = {**signing, **leaves}
        issued = certificates.issue(parent, live, revoke, self._clock.wall(), asked)
        for role, why in issued.made:
            _log.info("Made certificate", **self._subject.words, role=role, reason=why.reason)
        applied = await self._authorities.apply(issued.authorities)
        if applied.complete:  # a leaf would be worthless if its authority is not stored
            applied = await self._apply(issued.leaves)
        if not applied.complete:
            # A certificate that is not stored must not be handed out: the next pass would sign another one.
            content = certificates.content_hash(self._snapshot.ours(*keys["cloud"], self._subject.uid))
            return Secrets(applied.verdict, kept, content)
        return self._noted(issued, asked, kept)

    def _as_preread(self, parent: Parent, asked: str) -> certificates.Issued | None:
        """Return the result from the Secrets as read at the start; None: something is to be done."""
        uid, take = self._subject.uid, self._preread.take
        live = self._authorities.preread()
        for role, (_, name) in certificates.secret_keys(parent.name).items():
            live[role] = take(self._store, self._subject.namespace, name)
        there = {key_of(secret): secret for secret in live.values() if secret is not None}
        if len(there) < len(certificates.ROLES) or parent.spec.transport.certificates.issuer_ref is not None:
            return None
        issued = certificates.issue(
            parent, live, self._subject.annotation(certificates.REVOKE), self._clock.wall(), asked
        )
        steps = plan(issued.secrets, there, uid)
        return None if issued.made or issued.answer or steps.touched or steps.obstacles else issued

    def _noted(self, issued: certificates.Issued, asked: str, kept: frozenset[Key]) -> Secrets:
        """Remember the result, so that the next pass reads no keys."""
        leaves: dict[certificates.Role, Manifest | None] = dict(zip(certificates.LEAVES, issued.leaves, strict=True))
        keys = certificates.secret_keys(self._subject.name)
        based_on = self._based_on(keys.values(), self._subject.annotation(certificates.REVOKE), asked)
        content, ends = certificates.content_hash(leaves["cloud"]), _ends(leaves)
        renewal_s = self._clock.steady_s() + issued.recheck_s
        self._memory.secrets = Certified(based_on, issued.verdict, content, renewal_s, issued.answer, ends)
        return Secrets(issued.verdict, kept, content, issued.recheck_s, answer=issued.answer, ends=ends)

    def _based_on(self, keys: Iterable[Key], revoke: str, asked: str) -> object:
        """Return everything on which the certificates depend; None: the store does not know."""
        entries = [self._store.entry(kind, self._subject.namespace, name) for kind, name in keys]
        known = [(entry.uid, entry.version) for entry in entries if entry is not None]
        signing = self._authorities.known()
        complete = self._store.fed and len(known) == len(entries) and len(signing) == len(AUTHORITIES)
        return (self._subject.generation, revoke, asked, *signing, *known) if complete else None


@dataclass(frozen=True, slots=True)
class Judged:
    """The final judgement of the certificates.

    Attributes:
        verdict: for the condition CertificateCurrent.
        shown: for the status.
        recheck_s: seconds after which the verdict changes without an event; None: never.
    """

    verdict: Verdict
    shown: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    recheck_s: float | None = None


def judge(offload: RobotOffload, secrets: Secrets, robot: presented.Presented | None, now: datetime.datetime) -> Judged:
    """Judge the certificates; `robot` is the certificate with which the robot dials."""
    if not transport.needs_certificates(offload.spec):
        return Judged(yes("NotNeeded", "This transport uses no certificates"))
    margin = datetime.timedelta(milliseconds=offload.spec.transport.certificates.renew_before_ms)
    shown = {} if robot is None else {"robot": certificates.shown(robot.serial, robot.not_after)}
    return Judged(
        presented.verdict(robot, secrets.answer, margin, now),
        {**secrets.ends, **shown},
        presented.recheck_s(robot, margin, now),
    )


def _ends(live: Mapping[certificates.Role, Manifest | None]) -> dict[str, dict[str, str]]:
    found = {"cloud": certificates.ends(live.get("cloud")), "bundle": certificates.ends(live.get("robot"))}
    return {name: certificates.shown(*leaf) for name, leaf in found.items() if leaf is not None}
