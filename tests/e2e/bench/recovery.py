"""A link that is cut for a while: from the moment it is mended to the first command from the cloud."""

from __future__ import annotations

import statistics
from typing import Final

from robot_offload_lab.judge.measures import Measures
from robot_offload_lab.wire.loop import steady_s
from tests.e2e.bench.place import Place
from tests.e2e.figures import figure
from tests.e2e.judged import judged
from tests.e2e.story import READY

GROUP: Final = "recovery"
CUTS_S: Final = {1.0: 5, 10.0: 3, 60.0: 2}
"""Length of a cut and how often it is measured."""
CUTS_QUICK_S: Final = {1.0: 2, 10.0: 1}
CALM_S: Final = 10.0
"""Between two cuts: longer than what counts as flapping, which would make the next return slower."""


def measure(place: Place) -> None:
    """All lengths on one robot, with what its consumer heard meanwhile."""
    with place.story("recovery") as story:
        offload = story.apply(story.sample("wheelchair"))
        story.wait_conditions("wheelchair", *READY)
        robot = story.robot(offload)
        robot.listen()
        robot.start_nodes()
        robot.start_agent()
        robot.until_site("cloud", patience_s=90)
        robot.begin()
        mended: list[tuple[float, float, float]] = []
        for length_s, times in (CUTS_QUICK_S if place.quick else CUTS_S).items():
            for _ in range(times):
                robot.rest(CALM_S)
                cut_s = steady_s()
                robot.host.wire.set(cut="both")
                robot.rest(length_s)
                robot.host.wire.set(cut=None)
                mended.append((length_s, cut_s, steady_s()))
                robot.until_site("cloud", patience_s=120)
        robot.rest(CALM_S)
        measures = judged(robot.finish())
    for length_s in dict.fromkeys(each for each, _, _ in mended):
        back = [_back_s(measures, moment_s) for length, _, moment_s in mended if length == length_s]
        away = [_away_ms(measures, cut_s) for length, cut_s, _ in mended if length == length_s]
        figure(f"cut of {length_s:g} s: mended to first cloud command, median of {len(back)}", _median(back), "s")
        figure(f"cut of {length_s:g} s: longest silence at the cut, worst of {len(away)}", max(away), "ms")


def _back_s(measures: Measures, mended_s: float) -> float | None:
    """From the mended link to the first command of the cloud that passes."""
    arrivals = measures.recording.outputs["/cmd_vel"]
    return next((each.t_s - mended_s for each in arrivals if each.site == "cloud" and each.t_s > mended_s), None)


def _away_ms(measures: Measures, cut_s: float) -> float:
    """The longest silence of the output that touches the second after the cut."""
    gaps = measures.streams["/cmd_vel"].gaps
    return max((gap.length_ms for gap in gaps if gap.end_s > cut_s and gap.start_s < cut_s + 1.0), default=0.0)


def _median(values: list[float | None]) -> float | None:
    known = [each for each in values if each is not None]
    return statistics.median(known) if known else None
