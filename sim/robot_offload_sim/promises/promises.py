"""What the observer checks beside the robot's consumers: those in the cloud, other publishers, goals, statements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NoReturn

from robot_offload_core.control.robot import placement
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.control.robot.limits import DATA_TIMEOUT_S
from robot_offload_core.control.robot.placement import IN_CHARGE
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Decided
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import Settings
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload
from robot_offload_sim.world.violations import ViolationError

OTHERS = "others"
"""Producer name of publishers outside the group on a shared topic."""
HANDING = frozenset({Reason.GOALS_PENDING, Reason.DIVERGED, Reason.REPLICA_PARAMETERS_DIFFER})
"""Reasons for which a change may wait, but which never end a stay."""
RIVAL_S = 3.0
"""A look at the graph, a report with details, a changeover or a takeover by the activation deadline."""
FORGOTTEN_S = 2.0
"""How long control may know of a second publisher after its end: a look, a report, the lifting of an inhibit."""

Rank = tuple[int, int, int]
Stay = tuple[int, int]


def loosest(settings: tuple[Settings, ...]) -> Settings:
    """Return the longest of each limit among settings that may be requested, so that bounds hold through a change."""
    return replace(
        settings[0],
        lease_s=max(s.lease_s for s in settings),
        loss_timeout_s=max(s.loss_timeout_s for s in settings),
        max_command_age_s=max(s.max_command_age_s for s in settings),
        activation_deadline_s=max(s.activation_deadline_s for s in settings),
    )


class Promises:
    """Checks the promises in the docstrings of its methods."""

    def __init__(self, run: System, quiet_s: Callable[[], float]) -> None:
        self.run = run
        self.world = run.world
        self.quiet_s = quiet_s
        scenario = run.scenario
        asked = (scenario.settings, *scenario.asked)
        self.settings = loosest(asked)
        self.strictest_loss_s = min(s.loss_timeout_s for s in asked)
        self.order: dict[str, int] = {}
        self.passed_under: dict[Message, Stay] = {}
        self.cloud_heard: tuple[int, Stay, Site | None] = (0, (-1, 0), None)
        self.rival_s: float | None = None
        self.rival_gone_s = -1e9
        self.stated: dict[str, float] = {}
        self.result_s: dict[int, float] = {}

    def violated(self, invariant: str, text: str) -> NoReturn:
        """End the stretch."""
        raise ViolationError(invariant, text, self.world.now)

    def heard_in_cloud(self, index: int, payload: Payload) -> None:
        """Invariant 9, for consumers in the cloud: they hear one side at a time, in the order of the stays in charge.

        Never a message of an older stay after one of a newer, and of one stay one side only; of the robot only what has
        passed at its collector. A data process that starts anew knows of no stay.
        """
        output = self.run.scenario.outputs[index]
        if output.of_cloud or payload.message.producer == OTHERS:
            return
        data = self.run.cloud.data
        if payload.site is Site.ROBOT:
            if payload.message not in self.passed_under:
                self.violated("9", f"{payload.message.producer} was heard in the cloud and has not passed on the robot")
            stay = self.passed_under[payload.message]
        else:
            token = data.process.egress.egress.token
            if token is None:
                self.violated("9", "consumers in the cloud heard its replica, which nobody permits to act")
            stay = self.order.get(token.robot, -2), token.epoch
        life, before, site = self.cloud_heard
        if life == data.life and (stay < before or (stay == before and payload.site is not site)):
            held = site.value if site else "nobody"
            self.violated("9", f"in the cloud the {payload.site.value} of stay {stay} after the {held} of {before}")
        self.cloud_heard = data.life, stay, payload.site

    def filled(self, side: Site, index: int, payload: Payload) -> None:
        """Invariant 9, for shared topics: a replica never gets back what its own side has said."""
        if payload.site is side and payload.message.producer != OTHERS:
            self.violated("9", f"{payload.message.producer} on the {side.value} heard itself on output {index}")

    def check_reason(self, decided: Decided) -> None:
        """Invariant 10: no hard limit follows from a goal, a request, a parameter or a snapshot alone."""
        if decided.silent_s is not None and decided.verdict.reason in HANDING:
            self.violated("10", f"a stay in the cloud was ended for {decided.verdict.reason.value}")

    def check_rival(self, robot: placement.Robot) -> None:
        """Invariant 11: with a second publisher and nothing else wrong the robot acts; with `strict` the wheels stand.

        That is, RIVAL_S after the publisher appeared, whatever goals and state wait for. A robot that cannot act does
        not keep the cloud in charge either.
        """
        now, run = self.world.now, self.run
        if not run.rivals:
            if self.rival_s is not None:
                self.rival_s, self.rival_gone_s = None, now
            return
        self.rival_s = now if self.rival_s is None else self.rival_s
        if min(now - self.rival_s, self.quiet_s()) <= RIVAL_S:
            return
        if IN_CHARGE[robot.phase] is Site.CLOUD:
            self.violated("11", "the cloud is in charge in spite of a second publisher")
        if run.scenario.strict and not run.driver.inhibited:
            self.violated("11", "the wheels are free in spite of a second publisher (strict)")

    def rivalled(self) -> bool:
        """Return whether control may know of a second publisher."""
        present = bool(self.run.rivals) or self.rival_s is not None  # or gone since the last look
        return present or self.world.now - self.rival_gone_s < FORGOTTEN_S

    def stands_for_rival(self) -> bool:
        """Return whether the wheels may stand for a second publisher, whoever is in charge."""
        return self.run.scenario.strict and self.rivalled()

    def available(self, statements: tuple[Available, ...]) -> None:
        """Note that the robot's control states which nodes with placement Cloud have results that arrive."""
        for statement in statements:
            self.world.note(statement.node, statement.reason.value if statement.reason else "available")
            if statement.reason is None:
                self.stated.setdefault(statement.node, self.world.now)
            else:
                self.stated.pop(statement.node, None)

    def check_stated(self, running_s: float) -> None:
        """Invariant 1f: of a node that is stated to be available results arrive, while control and collector run.

        The statement is taken back within the deadline of the output, the silence of the data session and a lease.
        """
        if not self.stated:
            return
        run, settings = self.run, self.settings
        since_s = max(running_s, run.robot.collector.running_since_s)
        for index, output in enumerate(run.scenario.outputs):
            if not output.of_cloud or output.nodes[0] not in self.stated:
                continue
            limit_s = output.deadline_s + DATA_TIMEOUT_S + settings.lease_s + 2 * run.scenario.reaction_s
            base_s = max(since_s, self.stated[output.nodes[0]], self.result_s.get(index, 0.0))
            if self.world.now - base_s > limit_s:
                silent_ms = (self.world.now - base_s) * 1e3
                self.violated("1f", f"{output.nodes[0]} is stated to be available after {silent_ms:.0f} ms of silence")
