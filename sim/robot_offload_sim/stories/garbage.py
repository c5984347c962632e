"""Stories of garbage and other versions in every channel: neither is taken for a message or holds anything up."""

from __future__ import annotations

from functools import partial

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.declared import SnapshotState
from robot_offload_core.words.reasons import Reason
from robot_offload_sim.faults import garbage
from robot_offload_sim.stories.goal_stage import GoalStage
from robot_offload_sim.stories.stage import Stage

STATES = {"controller_1": SnapshotState("controller", max_age_s=0.5, max_size=1024)}


def _refused(stage: Stage) -> dict[str, int]:
    """Return how much garbage each channel of each side has refused."""
    assert stage.system.handing is not None
    found: dict[str, int] = {}
    for site, side in ((Site.ROBOT, stage.robot), (Site.CLOUD, stage.cloud)):
        counters = side.data.process.counters
        found |= {f"{site.value} {key}": counters[key] for key in ("garbage.envelope", "garbage.probe")}
        found[f"{site.value} state"] = sum(n for key, n in counters.items() if key.startswith("state controller_1.ref"))
    found["robot relay"] = stage.system.handing.robot.process.post.counters["garbage"]
    found["cloud relay"] = stage.system.handing.cloud.process.post.counters["garbage"]
    return found


def garbage_in_every_channel() -> None:
    """Beside each message something wrong arrives: sides change over, goals end, state is known, none of it passes."""
    stage = GoalStage(states=STATES)
    garbage.let_in(stage.link, share=1.0)
    for site in Site:
        stage.traits(site).takes_s = 1.0
    stage.on_robot()
    for site in (Site.CLOUD, Site.ROBOT, Site.CLOUD):
        stage.pin(site)
        stage.until(lambda at=site: stage.site is at, 4.0, f"the {site.value} acts")  # type: ignore[misc]
        goal = stage.goal()
        stage.ends(goal, GoalStatus.SUCCEEDED)
        stage.always(lambda at=site: stage.site is at, 2.0, "nothing ends the stay")  # type: ignore[misc]
    strange = [key for key in stage.robot.collector.process.counters if key.endswith(Reason.TYPES_DIFFER)]
    stage.expect(not strange, "types of another version were believed")
    few = {name: count for name, count in _refused(stage).items() if count < 10}
    stage.expect(not few, f"garbage was refused everywhere: {few}")


def garbage_beside_bare_beats() -> None:
    """Beats that prove no round trip contain little: a fault in one is noticed anyway, and nothing follows."""
    for number in range(3):
        stage = Stage(f"story {number}")
        stage.in_cloud()
        garbage.let_in(stage.link, share=1.0)
        stage.cloud.pulse.bare += 1
        stage.lost(0.5, "beats without an echo are no good ones")
        stage.run(0.5)
        stage.cloud.pulse.bare -= 1
        in_cloud = partial(lambda s: s.phase is Phase.CLOUD, stage)
        stage.until(in_cloud, 8.0, "no beat of the future hides those of the present")


STORIES = (garbage_in_every_channel, garbage_beside_bare_beats)
