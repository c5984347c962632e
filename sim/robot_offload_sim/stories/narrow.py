"""Stories of a link that carries less than the robot publishes."""

from __future__ import annotations

from typing import Any

from robot_offload_core.data.process import InputPlan
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.declared import Priority
from robot_offload_core.words.problems import Problem
from robot_offload_sim.stories.stage import Stage


class Narrow:
    """Lets the robot's data session take a number of input messages a second, evenly, and refuse the others."""

    def __init__(self, stage: Stage, carries: float) -> None:
        self.stage, self.carries = stage, carries
        self.room, self.looked_s = 1.0, stage.now
        self.taken: list[str] = []
        data = stage.robot.data
        self.wide = data.cross
        data.cross = self.cross  # type: ignore[method-assign]

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        """Send what there is room for."""
        if not channel.startswith("in/"):
            return self.wide(channel, header, payload)
        now_s = self.stage.now
        self.room, self.looked_s = min(2.0, self.room + (now_s - self.looked_s) * self.carries), now_s
        if self.room < 1:
            return False
        self.room -= 1
        self.taken.append(channel.removeprefix("in/"))
        return self.wide(channel, header, payload)


def narrow_link() -> None:
    """A link that carries less than is published: the input of low priority is thinned down to its least rate."""
    stage = Stage(
        inputs=(
            InputPlan("camera", min_rate_hz=2.0, priority=Priority.LOW),  # what comes first takes the room
            InputPlan("scan", 300, min_rate_hz=5.0, priority=Priority.HIGH),
            InputPlan("map", latched=True),
        ),
        input_periods_s=(0.05, 0.05, 60.0),
    )
    stage.in_cloud()
    narrow = Narrow(stage, carries=24.0)
    stage.run(20.0)
    narrow.taken.clear()
    stage.run(20.0)
    scan, camera = narrow.taken.count("scan") / 20, narrow.taken.count("camera") / 20
    stage.expect(scan >= 17, f"the scan of high priority was thinned to {scan} a second")
    stage.expect(1.5 <= camera <= 8, f"{camera} images a second, thinned down to 2 at most")
    stage.expect(stage.phase is Phase.CLOUD, "the cloud goes on")
    problems = stage.robot.data.process.problems
    stage.expect(problems["thinned camera"][0] == Problem.THINNED.value, "the camera's thinning is said")
    stage.expect("thinned scan" not in problems, "nothing is said of the scan")


def newest_first() -> None:
    """An input of which the newest counts: what was refused is sent as soon as there is room, unless a newer came."""
    stage = Stage(
        inputs=(InputPlan("camera", latest=True), InputPlan("map", latched=True)), input_periods_s=(0.5, 60.0)
    )
    heard: list[str] = []
    stage.seen.input_heard = lambda name, age_s: heard.append(name)  # type: ignore[method-assign]
    stage.in_cloud()
    narrow = Narrow(stage, carries=0.0)
    narrow.room = 0.0
    stage.run(1.2)
    heard.clear()
    narrow.room = 1.0
    stage.robot.data.process.room("camera")
    stage.run(0.1)
    stage.expect(len(heard) == 1, f"{len(heard)} images as soon as there is room")
    narrow.room = 1.0
    stage.robot.data.process.room("camera")
    stage.expect(len(narrow.taken) == 1, "it was sent once")


def late_but_in_time() -> None:
    """A link that loses packets refuses now and then and has room again before the next image: nothing is thinned."""
    stage = Stage(
        inputs=(InputPlan("camera", latest=True, min_rate_hz=3.0), InputPlan("map", latched=True)),
        input_periods_s=(0.1, 60.0),
    )
    stage.in_cloud()
    data = stage.robot.data
    wide, offered = data.cross, [0]

    def cross(channel: str, header: bytes, payload: Any) -> bool:
        """Refuse one message of three; the next one it is offered passes."""
        offered[0] += channel.startswith("in/camera")
        return not (channel.startswith("in/camera") and offered[0] % 4 == 0) and wide(channel, header, payload)

    data.cross = cross  # type: ignore[method-assign]
    for _ in range(200):
        stage.run(0.05)
        data.process.room("camera")
    stage.expect(offered[0] > 80, f"{offered[0]} images were offered")
    stage.expect(data.process.counters["camera.sent_later"] > 10, "some waited for room")
    stage.expect(data.process.counters["camera.thinned"] == 0, "an image that was sent in time slows nothing")


STORIES = (narrow_link, newest_first, late_but_in_time)
