"""Stories of the fence: until when the cloud acts, whose effects are admitted, and strangers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robot_offload_core.control.robot import switcher
from robot_offload_core.data.process import InputPlan
from robot_offload_core.fence.token import Site
from robot_offload_core.pulse import pulse
from robot_offload_core.words.beats import Beat, CloudReport, Echo, Permission
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.messages import CollectorStatus, Speak
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import OutputSpec, Settings
from robot_offload_sim.stories.stage import CONTROLLER, STRANGER, Stage
from robot_offload_sim.world.scenario import UID, Replica
from robot_offload_sim.world.world import Host

SLOW = Settings(loss_timeout_s=0.3, lease_s=0.8, max_command_age_s=0.4)
Send = Callable[[str, object], bool]


def cloud_ends_by_itself() -> None:
    """Robot's and cloud's control stop: nothing leaves the cloud after the lease of the last grant (invariant 2)."""
    stage = Stage(cloud_settings=Settings(lease_s=0.6))
    stage.in_cloud()
    stage.stall(stage.robot.control, 1.0)
    stage.run(1.5)
    stage.until(lambda: stage.phase is Phase.CLOUD, 12.0, "the cloud is used again")
    stage.run(0.5)
    stage.stall(stage.robot.control, 1.0)
    stage.stall(stage.cloud.control, 1.2)
    stage.run(1.5)


def paused_cloud_control() -> None:
    """A pause of the cloud's control voids its lease until a grant echoes a beat that was sent after the pause."""
    stage = Stage(settings=SLOW, cloud_settings=SLOW, delay_s=0.02)
    stage.in_cloud()
    stage.stall(stage.cloud.control, 0.2)
    stage.run(0.2005)
    resumed_s = stage.now
    stage.run(0.06)
    left = [at_s for at_s in stage.seen.left if resumed_s + 0.003 < at_s < resumed_s + 0.04]
    stage.expect(not left, f"{len(left)} messages left under a lease from before the pause")


def stranger_in_the_echo() -> None:
    """A grant for another cloud, or one that echoes another's beat, gives no lease."""
    stage = Stage()
    stage.start()
    stage.run(0.3)
    stage.pin(Site.ROBOT)
    stage.run(1.0)
    mine, robot = stage.cloud.control.process.incarnation, stage.machine
    for named, echoed in ((mine, STRANGER), (STRANGER, STRANGER)):
        permission = Permission(robot.epoch, True, named, 250_000)
        sent_us = round(stage.robot.host.now_s() * 1e6)
        echo = Echo(echoed, 1, round(stage.cloud.host.now_s() * 1e6) - 1000, 0)
        beat = Beat(UID, Site.ROBOT, robot.incarnation, 1, sent_us, 0, 0, echo, permission)
        stage.cloud.control.beat(beat, stage.cloud.host.now_s(), 0, stage.now)
        stage.expect(stage.cloud.control.cloud.lease.end_s == 0.0, "a lease out of a stranger's clock")
        stage.run(0.02)
    permission = Permission(robot.epoch, True, STRANGER, 250_000)
    echo = Echo(mine, 1, round(stage.cloud.host.now_s() * 1e6) - 1000, 0)
    beat = Beat(UID, Site.ROBOT, robot.incarnation, 1, round(stage.robot.host.now_s() * 1e6), 0, 0, echo, permission)
    stage.cloud.control.beat(beat, stage.cloud.host.now_s(), 0, stage.now)
    stage.expect(stage.cloud.control.cloud.lease.end_s == 0.0, "a lease for another cloud")


def old_grants() -> None:
    """Grants of an earlier epoch that arrive again change nothing (pulse, lease: order of beats, epochs)."""
    stage = Stage()
    stage.start()
    beats: list[Beat] = []
    sent = stage.seen.beat_sent
    stage.seen.beat_sent = lambda beat: (beats.append(beat), sent(beat))[1]  # type: ignore[method-assign,func-returns-value]
    stage.until(lambda: stage.phase is Phase.CLOUD, 8.0, "the cloud is in charge")
    stage.run(0.3)
    stage.by_hand(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.ROBOT, 1.0, "the robot is in charge")
    old = beats[-12]
    stage.run(0.1)
    stage.cloud.pulse.hear(old, stage.now)
    stage.run(0.01)
    stage.expect(stage.cloud.control.cloud.lease.end_s == 0.0, "no lease of an old epoch")


def second_robot() -> None:
    """A second robot of the same identity is refused while the first is live, and served when the first has gone."""
    stage = Stage()
    stage.in_cloud()
    first = stage.machine.incarnation
    host = Host(stage.world, "other robot")
    state = pulse.Pulse(UID, Site.ROBOT, 0.02)

    def beat() -> None:
        nonlocal state
        permission = Permission(1, True, stage.cloud.control.process.incarnation, 250_000)
        state = pulse.speak(state, STRANGER, permission, host.now_s())
        state, sent = pulse.compose(state, host.now_s(), host.wall_us)
        stage.cloud.pulse.deliver(stage.cloud.pulse.hear, sent, stage.now)
        stage.world.after(0.02, beat)

    beat()
    stage.always(lambda: stage.cloud.control.cloud.robot == first, 2.0, "the first robot is served")
    stage.expect(stage.cloud.control.cloud.refused == STRANGER, "the second one is refused, with its name")
    stage.expect(stage.phase is Phase.CLOUD, "the first one notices nothing")
    for process in stage.robot.processes:
        process.kill(1e9)
    stage.until(lambda: stage.cloud.control.cloud.robot == STRANGER, 2.5, "the other robot is served in the end")


def robot_that_went() -> None:
    """A robot that has gone is forgotten."""
    stage = Stage()
    stage.in_cloud()
    for process in stage.robot.processes:
        process.kill(1e9)
    stage.until(lambda: not stage.cloud.control.cloud.robot, 2.5, "the robot that has gone is forgotten")


def foreign_beats() -> None:
    """Beats of another deployment, and our own side's, are ignored."""
    stage = Stage()
    stage.start()
    stage.run(0.1)
    foreign = pulse.speak(
        pulse.Pulse("somebody-else", Site.ROBOT, 0.02), STRANGER, Permission(7, True, "", 250_000), 0.0
    )

    def speak() -> None:
        nonlocal foreign
        foreign, beat = pulse.compose(foreign, stage.now + 5, 0)
        stage.cloud.pulse.deliver(stage.cloud.pulse.hear, beat, stage.now)
        own = replace(beat, uid=UID, sender=Site.CLOUD, body=CloudReport("", 0, False, False, "", 0, ()))
        stage.cloud.pulse.deliver(stage.cloud.pulse.hear, own, stage.now)
        stage.world.after(0.02, speak)

    speak()
    stage.always(lambda: stage.cloud.control.cloud.robot != STRANGER, 2.5, "a foreign robot is not served")
    stage.expect(stage.cloud.control.cloud.refused == "", "and is no second one of ours")
    stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is used")


def second_cloud() -> None:
    """A second cloud agent that claims to act has no effect: the one in charge goes on."""
    stage = Stage()
    stage.in_cloud()
    host = Host(stage.world, "other cloud")
    state = pulse.Pulse(UID, Site.CLOUD, 0.02)

    def beat() -> None:
        nonlocal state
        robot = stage.machine
        report = CloudReport(robot.incarnation, robot.epoch, True, True, "", 0, (0,))
        state = pulse.speak(state, STRANGER, report, host.now_s())
        state, sent = pulse.compose(state, host.now_s(), host.wall_us)
        stage.robot.pulse.deliver(stage.robot.pulse.hear, sent, stage.now)
        stage.world.after(0.017, beat)

    beat()
    stage.always(lambda: stage.phase is Phase.CLOUD, 3.0, "the cloud in charge goes on")


def vouching() -> None:
    """A pulse whose control has stopped grants for two beats and no longer."""
    stage = Stage()
    stage.in_cloud()
    stage.stall(stage.robot.control, 0.2)
    stage.run(0.5)


def _effects_are_exclusive(stage: Stage, for_s: float) -> None:
    """No instant in which the robot's effects are admitted and the cloud may still send under an older epoch."""
    end_s = stage.now + for_s
    egress = stage.cloud.data.process
    while stage.now < end_s:
        admitted = switcher.effects_site(stage.machine, stage.robot.host.now_s()) is Site.ROBOT
        token, lease_end_s = egress.egress.egress.token, egress.egress.egress.lease_end_s
        may_leave = token is not None and stage.cloud.host.now_s() < lease_end_s
        stage.expect(not (admitted and may_leave), "both sides' effects are admitted")
        stage.run(0.0005)


def _lost_without_a_word(stage: Stage) -> None:
    """Let the cloud fall silent on a living link, and the revocation that follows never reach the pulse."""
    decided = stage.seen.robot_decided

    def deafen(decision: Decided) -> None:
        decided(decision)
        if decision.switched:
            stage.deaf("control", "pulse", 0.2)

    stage.seen.robot_decided = deafen  # type: ignore[method-assign,assignment]
    stage.hush("cloud")
    stage.lost(0.3, "the loss")


def effects_wait_for_the_lease() -> None:
    """The robot's effects wait for the end of the last lease, also when its pulse did not hear of the revocation."""
    for number in range(8):
        stage = Stage(f"story {number}", delay_s=0.0005, jitter_s=0.0001, drops=False)
        stage.in_cloud()
        _lost_without_a_word(stage)
        stage.run(0.15)
        _effects_are_exclusive(stage, 0.25)


def slow_clock_in_the_cloud() -> None:
    """The same with a cloud whose clock is slow, and a long lease: the margin for drift."""
    long = Settings(lease_s=40.0)
    for number in range(3):
        stage = Stage(
            f"story {number}", settings=long, cloud_settings=long, delay_s=0.0005, jitter_s=0.0001, drops=False
        )
        stage.cloud.host.rate, stage.robot.host.rate = 0.99905, 1.00002
        stage.in_cloud()
        _lost_without_a_word(stage)
        stage.run(0.1)
        for process in (stage.robot.pulse, stage.cloud.pulse, stage.robot.data, *stage.cloud.nodes.values()):
            process.kill(1e9)  # they would only take time
        stage.run(39.85)
        _effects_are_exclusive(stage, 0.2)


def shorter_lease_at_run_time() -> None:
    """A lease that was made shorter: effects wait for the end of the longer one that is still out."""
    long = Settings(lease_s=2.0)
    stage = Stage(settings=long, cloud_settings=long)
    stage.in_cloud()
    stage.robot.control.adopt(replace(long, lease_s=0.25))
    stage.run(0.1)
    stage.cut()
    stage.lost(0.3, "the loss")
    _effects_are_exclusive(stage, 2.5)


def effects_while_offered() -> None:
    """While a changeover is offered to the collector no other side's effects are admitted."""
    stage = Stage(replicas={"controller": Replica(0, 0.05, on_activate=True)})
    stage.start()
    stage.until(lambda: stage.offered, 6.0, "the changeover is offered")
    _effects_are_exclusive(stage, 0.3)


def called_off() -> None:
    """A preparation that is called off after it was offered is ended by a newer epoch."""
    stage = Stage()
    stage.start()
    stage.robot_acts()
    stage.cloud.nodes["controller"].hung = 1
    stage.until(lambda: stage.offered, 6.0, "the changeover is offered")
    candidate = stage.machine.candidate
    stage.pin(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.ROBOT, 0.1, "called off")
    stage.expect(stage.machine.epoch > candidate, "by an epoch that is newer than the candidate")


def lease_of_an_ended_epoch() -> None:
    """A newer epoch without a grant ends the lease: what the cloud has left of the older one permits nothing (2)."""
    stage = Stage(drops=False)
    stage.in_cloud()
    stage.robot.collector.kill(0.4)
    stage.lost(0.5, "without a collector the robot is in charge")
    stage.run(1.0)


def unpermitted() -> None:
    """A cloud whose grants stopped says that it does not act, which ends its stay, also with no rated output."""
    stage = Stage(
        outputs=(OutputSpec("cmd_vel", 0.0),), inputs=(InputPlan("scan"),), input_periods_s=(0.05,),
        cloud_nodes=(replace(CONTROLLER, hot=True),),
    )  # fmt: skip
    stage.in_cloud()
    stage.deaf("control", "pulse", 2.0)
    stage.lost(stage.scenario.settings.lease_s + 0.1, "a cloud that does not act any more")


def served_elsewhere() -> None:
    """A cloud that serves another robot, or acts under another epoch, is not ours."""
    for change in ({"serves": STRANGER}, {"epoch": 99}):
        stage = Stage(outputs=(OutputSpec("cmd_vel", 0.0),), inputs=(InputPlan("scan"),), input_periods_s=(0.05,))
        stage.in_cloud()
        control = stage.cloud.control
        send = control.send

        def lie(to: str, message: object, send: Send = send, change: dict[str, Any] = change) -> bool:
            if isinstance(message, Speak) and isinstance(message.body, CloudReport):
                message = replace(message, body=replace(message.body, **change))
            return send(to, message)

        control.send = lie  # type: ignore[method-assign]
        stage.lost(0.13, f"a cloud of another robot or epoch: {sorted(change)}")


def restarted_control() -> None:
    """A control that restarts takes nothing of an earlier one for its own: the robot is in charge."""
    stage = Stage()
    stage.in_cloud()
    for site in (Site.ROBOT, Site.CLOUD, Site.ROBOT, Site.CLOUD):
        stage.by_hand(site)
        stage.run(1.0)
    report = stage.machine.situation.gate
    assert report is not None
    stage.robot.control.kill(0.03)
    stage.run(0.035)
    stage.robot.control.take(CollectorStatus(report))  # what the collector said before it heard of the new control
    stage.always(lambda: stage.site is Site.ROBOT, 0.3, "a new control takes an old charge for its own")


STORIES = (
    cloud_ends_by_itself,
    paused_cloud_control,
    stranger_in_the_echo,
    old_grants,
    second_robot,
    robot_that_went,
    foreign_beats,
    second_cloud,
    vouching,
    effects_wait_for_the_lease,
    slow_clock_in_the_cloud,
    shorter_lease_at_run_time,
    effects_while_offered,
    called_off,
    lease_of_an_ended_epoch,
    restarted_control,
    unpermitted,
    served_elsewhere,
)
