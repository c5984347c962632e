"""Parties that should not exist: a second robot of the same identity, a second cloud agent, garbage on the wire."""

from __future__ import annotations

from collections.abc import Callable

from robot_offload_core.fence.token import Site
from robot_offload_core.pulse import pulse
from robot_offload_core.pulse.pulse import Pulse
from robot_offload_core.words.beats import Beat, CloudReport, Permission
from robot_offload_sim.sides.cloud_side import CloudSide
from robot_offload_sim.sides.robot_side import RobotSide
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.scenario import UID
from robot_offload_sim.world.world import Host

GARBAGE = ("", "1", "2 x", "1 wheelchair-7 r", "\0" * 40, "1 " * 200, "1 wheelchair-7 q - 1 1 1 1 - - - -")


class OtherRobot:
    """Another robot, from a copied bundle with our uid, that grants leases of its own to the same cloud."""

    def __init__(self, run: System, pick: float) -> None:
        self.run = run
        self.host = Host(run.world, "other robot")
        self.incarnation = f"{run.world.dice.getrandbits(128):032x}"
        self.period_s = run.scenario.settings.beat_period_s
        self.state = pulse.Pulse(UID, Site.ROBOT, self.period_s)
        self.granted = pick < 0.7
        self.here = True
        self._beat()

    def leave(self) -> None:
        """Switch it off."""
        self.here = False

    def _beat(self) -> None:
        if not self.here:
            return
        run, now_s = self.run, self.host.now_s()
        heard = run.cloud.pulse.last
        if heard is not None:
            self.state, _ = pulse.hear(self.state, heard, now_s)
            cloud = heard.incarnation
            permission = Permission(1, self.granted, cloud, round(run.scenario.settings.lease_s * 1e6))
            self.state = pulse.speak(self.state, self.incarnation, permission, now_s)
            self.state, beat = pulse.compose(self.state, now_s, self.host.wall_us)
            target = run.cloud.pulse
            run.world.after(0.01, target.deliver, target.hear, beat, run.world.now)
        run.world.after(self.period_s, self._beat)


def other_cloud(run: System, duration_s: float, pick: float) -> Callable[[], None]:
    """Add a second cloud agent (two pods with one name) whose beats reach the robot; it may claim to act."""
    host = Host(run.world, "other cloud")
    incarnation = f"{run.world.dice.getrandbits(128):032x}"
    period_s = run.scenario.settings.beat_period_s
    state = pulse.Pulse(UID, Site.CLOUD, period_s)
    claims = pick * 53 % 1 < 0.5
    end_s = run.world.now + duration_s

    def beat() -> None:
        nonlocal state
        if run.world.now >= end_s:
            return
        robot = run.robot.control.robot
        served = robot.incarnation if claims else ""
        report = CloudReport(served, robot.epoch, claims, True, "", 0, (0,))
        state = pulse.speak(state, incarnation, report, host.now_s())
        state, sent = pulse.compose(state, host.now_s(), host.wall_us)
        target = run.robot.pulse
        run.world.after(0.01, target.deliver, target.hear, sent, run.world.now)
        run.world.after(period_s, beat)

    beat()
    return lambda: None


def babble(run: System, duration_s: float) -> Callable[[], None]:
    """Send garbage, beats of foreign deployments, and bare beats in the names of the two sides."""
    end_s = run.world.now + duration_s
    foreign = pulse.Pulse("somebody-else", Site.CLOUD, 0.02)

    def speak() -> None:
        if run.world.now >= end_s:
            return
        dice = run.world.dice
        _, beat = pulse.compose(foreign, run.world.now, 0)
        for target, other in ((run.robot.pulse, run.cloud), (run.cloud.pulse, run.robot)):
            target.deliver(target.hear, dice.choice(GARBAGE), run.world.now)
            target.deliver(target.hear, beat, run.world.now)
            target.deliver(target.hear, _bare(other), run.world.now)
        run.world.after(0.013, speak)

    speak()
    return lambda: None


def _bare(side: RobotSide | CloudSide) -> Beat:
    """Return a beat without content: it proves no round trip and renews nothing."""
    own = Pulse(UID, Site.ROBOT if isinstance(side, RobotSide) else Site.CLOUD, 0.02, side.control.process.incarnation)
    return pulse.compose(own, side.host.now_s(), side.host.wall_us)[1]
