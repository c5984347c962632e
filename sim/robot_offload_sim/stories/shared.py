"""Stories of topics that the group and others say: each replica hears all of it once, consumers hear one side of it."""

from __future__ import annotations

from dataclasses import replace

from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.settings import NodeSpec, OutputSpec
from robot_offload_sim.promises.promises import OTHERS
from robot_offload_sim.stories.stage import CONTROLLER, Stage
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload
from robot_offload_sim.world.scenario import Replica

SHARED = 1
OTHERS_S = 0.033
POSES = OutputSpec("poses", 0.0, shared=True, nodes=("localizer",))


class Others:
    """A publisher outside the group that publishes on the robot's shared topic without end."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.said = 0
        self._say()

    def _say(self) -> None:
        stage = self.stage
        self.said += 1
        collector = stage.robot.collector
        payload = Payload(Site.ROBOT, Message(OTHERS, 1, self.said, stage.now), b"", stage.now)
        if collector.alive:
            collector.post(OTHERS, collector.others, SHARED, payload)
        stage.world.after(OTHERS_S, self._say)

    def given(self, side: Site) -> int:
        """Return how much of it the replica of a side was given."""
        times = [m.born_s for _, to, m in self.stage.seen.fills if to is side and m.others]
        self.stage.expect(len(times) == len(set(times)), f"the replica of the {side.value} hears others once")
        return len(times)


def _stage(*, hot: bool = False, latched: bool = False) -> Stage:
    localizer = NodeSpec("localizer", lifecycle=not hot, hot=hot)
    return Stage(
        nodes=(CONTROLLER, localizer), mirrored=(0, 1),
        outputs=(OutputSpec("cmd_vel", 0.15), replace(POSES, latched=latched)),
        replicas={"controller": Replica(0, 0.05), "localizer": Replica(SHARED, 0.05)},
    )  # fmt: skip


def _until_in_charge(stage: Stage, site: Site) -> None:
    stage.until(lambda: stage.site is site, 2.0, f"the {site.value} is in charge as pinned")


def shared_topic_through_changeovers() -> None:
    """Through ten changeovers both replicas hear all of the topic once: others, and on the standby the holder."""
    for hot in (False, True):
        stage = _stage(hot=hot)
        stage.start()
        stage.until_phase(Phase.CLOUD, 8.0, "the cloud is in charge")
        others, from_s = Others(stage), stage.now
        for site in (Site.ROBOT, Site.CLOUD) * 5:
            stage.pin(site)
            _until_in_charge(stage, site)
            began_s = stage.now
            stage.run(0.6)
            given = [m for at_s, to, m in stage.seen.fills if at_s > began_s and to is site.other and m.site is site]
            stage.expect(len([m for m in given if not m.others]) >= 8, f"the standby hears the {site.value}")
        stage.run(0.3)
        for side in Site:
            stage.expect(others.given(side) >= others.said - 2, f"others are heard on the {side.value}")
        heard = [m for m in stage.seen.in_cloud if m.index == SHARED and m.others]
        stage.expect(len(heard) >= others.said - 2, "and by consumers in the cloud")
        gap_s = stage.longest_gap(from_s, SHARED)
        stage.expect(gap_s < 0.15, f"{gap_s * 1e3:.0f} ms without a message of the group")


def shared_topic_without_a_link() -> None:
    """Through a cut the robot's replica hears others without a gap; after it the cloud's hears no message twice."""
    stage = _stage()
    stage.in_cloud()
    others = Others(stage)
    join = stage.cut()
    stage.run(2.0)
    stage.expect(others.given(Site.ROBOT) >= others.said - 2, "others are heard on the robot")
    join()
    stage.run(3.0)
    stage.robot.collector.kill(0.2)
    stage.run(1.0)
    before = others.given(Site.CLOUD)
    stage.run(1.0)
    stage.expect(others.given(Site.CLOUD) - before >= 25, "and in the cloud again")


def latched_words_of_others() -> None:
    """What others said once before there was a link reaches a cloud that comes later, each time it begins anew."""
    stage = _stage(latched=True)
    stage.start()
    join = stage.cut()
    stage.robot_acts()
    collector, said_s = stage.robot.collector, []
    for number in (1, 2):
        message = Message(OTHERS, 1, number, stage.now)
        said_s.append(message.born_s)
        collector.post(OTHERS, collector.others, SHARED, Payload(Site.ROBOT, message, b"", stage.now))
        stage.run(0.5)
    stage.expect(not any(to is Site.CLOUD for _, to, _ in stage.seen.fills), "there is no link yet")
    join()

    def heard(what: str) -> None:
        stage.until_phase(Phase.CLOUD, 12.0, "the cloud is in charge")
        stage.run(1.0)
        given = [m.born_s for _, to, m in stage.seen.fills if to is Site.CLOUD and m.others]
        stage.expect(given == said_s, f"the replica in the cloud hears each once {what}: {given}")
        stage.seen.fills.clear()

    heard("as soon as there is a link")
    stage.cloud.data.kill(0.1)
    heard("when its data process was started anew")
    stage.robot.data.kill(0.1)
    stage.run(8.0)
    stage.cloud.data.kill(0.1)
    heard("when those of both sides were")


STORIES = (shared_topic_through_changeovers, shared_topic_without_a_link, latched_words_of_others)
