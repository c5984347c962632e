"""Stories of nodes' state over changes: what the standby knows, and what a change waits for (handover, section 5)."""

from __future__ import annotations

from typing import Any

from robot_offload_core.control.robot.placement import CloudLeaving
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.declared import SnapshotState
from robot_offload_core.words.settings import Settings
from robot_offload_sim.sides.keeping import Kept
from robot_offload_sim.stories.stage import Stage

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD
NAME = "controller_1"
PATIENT = Settings(prepare_deadline_s=2.0)


class StateStage(Stage):
    """A stage whose controller has state."""

    def __init__(self, **changes: Any) -> None:
        super().__init__(states={NAME: SnapshotState("controller", max_age_s=0.5, max_size=1024)}, **changes)

    def kept(self, site: Site) -> Kept:
        """Return the node with state of a side."""
        assert self.system.keeping is not None
        return self.system.keeping.sides[site]

    def shown(self, name: str) -> int:
        """Return a counter of the robot's data process."""
        return int(self.robot.data.process.counters[f"state {NAME}.{name}"])

    def reasons(self) -> set[str]:
        """Return all reasons that were given so far."""
        return {decided.verdict.reason.value for _, decided in self.seen.decisions}


def state_over_changes() -> None:
    """The standby knows the newest state all the time, and a change waits for no more than that."""
    stage = StateStage()
    stage.in_cloud()
    for site in (ROBOT, CLOUD, ROBOT, CLOUD):
        stage.pin(site)
        stage.until(lambda at=site: stage.site is at, 3.0, f"the {site.value} acts")  # type: ignore[misc]
        before = stage.kept(site.other).took
        stage.run(2.0)
        stage.expect(stage.kept(site.other).took - before >= 15, "the standby is told all the time")
    stage.expect(stage.shown("changes") == 2, "both changes to the robot are counted")
    stage.expect(stage.shown("age_at_change_ms") <= 200, "its state was young")


def state_after_a_loss() -> None:
    """What the cloud knew shortly before it was lost, the robot goes on with; nothing late is restored."""
    stage = StateStage()
    stage.in_cloud()
    stage.run(1.0)
    cut_s = stage.now
    join = stage.cut()
    stage.lost(2.0, "the robot takes over")
    stage.expect(cut_s - stage.kept(ROBOT).restored_s <= 0.15, "the newest state is the cloud's last")
    join()
    stage.run(5.0)


def stale_state_is_waited_for() -> None:
    """A planned change is called off while the state is too old; a pin goes on without it at its deadline."""
    stage = StateStage()
    stage.in_cloud()
    stage.pin(ROBOT)
    stage.until(lambda: stage.site is ROBOT, 3.0, "the robot acts")
    stage.kept(ROBOT).silent += 1
    stage.run(2.0)
    stage.pin(None)
    stage.until(lambda: "StateStale" in stage.reasons(), 10.0, "a change is called off")
    stage.expect(stage.site is ROBOT, "the robot goes on")
    stage.pin(CLOUD)
    stage.until(lambda: stage.site is CLOUD, 10.0, "a pin does not wait for ever")


def _begins_with_state(stage: StateStage) -> None:
    stage.until(lambda: stage.site is CLOUD, 2.0, "the cloud acts")
    stage.expect(all(knew for _, knew in stage.kept(CLOUD).began), "its node begins with the robot's state")


def first_change_waits_for_state() -> None:
    """The cloud's nodes sleep until there is state to wake with, however late the robot's node says its first."""
    stage = StateStage()
    stage.kept(ROBOT).silent += 1
    stage.start()
    stage.until(lambda: "StateStale" in stage.reasons(), 5.0, "the change waits")
    stage.always(lambda: stage.phase is Phase.ROBOT, 3.0, "nothing is begun")
    stage.expect(not stage.kept(CLOUD).began, "the cloud's node sleeps")
    stage.kept(ROBOT).silent -= 1
    _begins_with_state(stage)


def first_change_waits_for_the_reader() -> None:
    """State that came and has not reached the node in the cloud yet does not wake it."""
    stage = StateStage()
    stage.kept(CLOUD).deaf += 1
    stage.start()
    stage.until(lambda: "StateStale" in stage.reasons(), 5.0, "the change waits")
    stage.expect(stage.kept(CLOUD).took > 0, "there is state")
    stage.always(lambda: stage.phase is Phase.ROBOT, 0.3, "nothing is begun")
    stage.kept(CLOUD).deaf -= 1
    _begins_with_state(stage)


def node_that_listens_to_nothing() -> None:
    """A node that takes no state while it sleeps holds nothing up for long."""
    stage = StateStage()
    stage.kept(CLOUD).deaf += 1
    stage.start()
    stage.until(lambda: stage.site is CLOUD, 6.0, "the cloud acts")


def state_grows_old_in_a_preparation() -> None:
    """State that is young when the cloud's nodes are woken, and too old when they are Active, calls the change off."""
    stage = StateStage(settings=PATIENT)
    stage.cloud.nodes["controller"].slow_s = 1.0
    stage.start()
    stage.until_phase(Phase.TO_CLOUD, 8.0, "the cloud gets ready")
    stage.kept(ROBOT).silent += 1
    stage.until(lambda: "StateStale" in stage.reasons(), 4.0, "the change is called off")
    stage.expect(stage.site is ROBOT, "the robot goes on")


def person_waits_for_state_once() -> None:
    """A pin waits for state before the other side's nodes wake, as long as a preparation may take, and not again."""
    for site, settings in ((CLOUD, Settings(prefer=ROBOT, prepare_deadline_s=2.0)), (ROBOT, PATIENT)):
        stage = StateStage(settings=settings)
        stage.kept(site.other).silent += 1
        stage.start()
        if site is ROBOT:
            stage.until(lambda at=stage: at.site is CLOUD, 8.0, "the cloud acts")  # type: ignore[misc]
        stage.run(2.0)
        begun = len(stage.kept(site).began)
        stage.pin(site)
        stage.always(lambda at=stage, to=site, n=begun: len(at.kept(to).began) == n, 1.9, "its node sleeps")  # type: ignore[misc]
        stage.until(lambda at=stage, to=site: at.site is to, 0.9, "a pin does not wait for ever")  # type: ignore[misc]


def veto_waits_for_no_state() -> None:
    """Of a cloud that stops the robot wakes its nodes at once, whatever they know."""
    stage = StateStage(settings=PATIENT)
    stage.kept(CLOUD).silent += 1
    stage.in_cloud()
    begun = len(stage.kept(ROBOT).began)
    stage.robot.control.step(CloudLeaving(stage.machine.link.peer, stage.robot.host.now_s() + 30.0))
    stage.until(lambda: len(stage.kept(ROBOT).began) > begun, 0.5, "the robot's node wakes")


def state_on_a_bad_link() -> None:
    """Snapshots are torn, lost, doubled, overtake each other: none of these is restored, ages are never too small."""
    stage = StateStage()
    stage.in_cloud()
    for wire in (stage.link.data.up, stage.link.data.down):
        wire.ordered = False
        wire.losses.append(0.2)
        wire.doubled = 0.5
        wire.reordering += 1
    for site in Site:
        stage.kept(site).torn = 0.2
    for site in (ROBOT, CLOUD, ROBOT):
        stage.pin(site)
        stage.until(lambda at=site: stage.site is at, 12.0, f"the {site.value} acts")  # type: ignore[misc]
        stage.run(5.0)
    stage.kept(ROBOT).silent += 1
    stage.run(3.0)  # what is said again is no younger for that
    stage.expect(min(kept.took for kept in stage.system.keeping.sides.values()) > 20, "many arrive")  # type: ignore[union-attr]


def data_processes_die_with_state() -> None:
    """A data process that begins anew gives its node nothing older than its predecessor did."""
    stage = StateStage()
    stage.in_cloud()
    for _ in range(4):
        for side in (stage.robot, stage.cloud):
            stage.run(1.0)
            side.data.kill(0.2)
            stage.run(2.0)


def snapshots_that_waited() -> None:
    """A snapshot that waited for a data process that stood still, for long or unnoticed, is no younger for that."""
    stage = StateStage()
    stage.in_cloud()
    stage.run(1.0)
    for duration_s in (0.11, 1.0, 0.11, 0.3, 0.11, 0.11):
        stage.stall(stage.cloud.data, duration_s)
        stage.run(duration_s + 1.0)
    stage.expect(stage.kept(ROBOT).took > 20, "the standby is told")


STORIES = (
    state_over_changes, state_after_a_loss, stale_state_is_waited_for, first_change_waits_for_state,
    first_change_waits_for_the_reader, node_that_listens_to_nothing, state_grows_old_in_a_preparation,
    person_waits_for_state_once, veto_waits_for_no_state, state_on_a_bad_link, data_processes_die_with_state,
    snapshots_that_waited,
)  # fmt: skip
