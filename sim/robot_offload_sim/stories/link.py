"""Stories of the link: cuts of every kind, what is noticed how fast, and what follows."""

from __future__ import annotations

from itertools import pairwise

from robot_offload_core.data import probe
from robot_offload_core.data.process import InputPlan
from robot_offload_core.fence.token import Site
from robot_offload_core.words.beats import Beat, Echo
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import OutputSpec, Settings
from robot_offload_sim.stories.stage import Stage

DELIVERY_S = 0.010
"""Two hand-overs and a turn."""
UNRATED = (OutputSpec("cmd_vel", 0.0),)


def first_command_after_a_cut() -> None:
    """After a cut of the link alone the robot's first command comes within its bound, many times."""
    stage = Stage("story of links")
    stage.in_cloud()
    settings = stage.scenario.settings
    for _ in range(3):
        stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is in charge again")
        stage.run(0.5)
        cut_s = stage.now
        lives = stage.link.pulse.life, stage.link.data.life
        join = stage.cut()
        stage.lost(settings.loss_timeout_s + stage.scenario.delay_s + DELIVERY_S, "the loss is noticed")
        bound_s = len(stage.robot.nodes) * stage.scenario.transition_s + settings.robot_period_s + 0.05
        stage.until_heard(cut_s + 0.08, Site.ROBOT, bound_s, "the robot's first command")
        stage.run(0.02)
        stage.expect(stage.link.pulse.life > lives[0], "the pulse session is opened anew at a loss")
        stage.expect(stage.link.data.life > lives[1], "and the data session")
        stage.run(0.3)
        join()


def beats_in_step() -> None:
    """The robot's beats go out with the cloud's, and at their own rate while none of those come."""
    stage = Stage()
    stage.in_cloud()
    sent_s: list[float] = []
    together = 0
    seen, period_s = stage.seen.beat_sent, stage.scenario.settings.beat_period_s

    def count(beat: Beat) -> None:
        nonlocal together
        sent_s.append(stage.now)
        together += beat.echo is not None and beat.echo.hold_us == 0
        seen(beat)

    stage.seen.beat_sent = count  # type: ignore[method-assign]
    stage.run(1.0)
    usual = round(1.0 / period_s)
    stage.expect(abs(len(sent_s) - usual) <= 3, f"{len(sent_s)} beats in a second")
    stage.expect(together > 0.8 * usual, f"{together} of {len(sent_s)} beats went out with one of the cloud")
    stage.robot.pulse.stop_for(0.07)
    stage.run(0.2)
    stage.cut("down")
    stage.run(0.3)
    sent_s.clear()
    stage.run(1.0)
    stage.expect(abs(len(sent_s) - usual) <= 3, f"{len(sent_s)} beats in a second without any of the cloud")


def beats_after_a_pause() -> None:
    """A pulse process that stood still neither catches up with its beats nor answers each of those that waited."""
    stage = Stage()
    stage.in_cloud()
    sent_s: list[float] = []
    seen = stage.seen.beat_sent
    stage.seen.beat_sent = lambda beat: (sent_s.append(stage.now), seen(beat))[1]  # type: ignore[method-assign,func-returns-value]
    for _ in range(3):
        stage.run(0.2)
        stage.robot.pulse.stop_for(0.07)
    stage.run(0.2)
    least_s = min(later - earlier for earlier, later in pairwise(sent_s))
    stage.expect(least_s > 0.2 * stage.scenario.settings.beat_period_s, f"two beats {least_s * 1e3:.1f} ms apart")


def hold_down_after_a_loss() -> None:
    """After a loss the cloud is not used again before the hold-down is over, also when it was asked for by hand."""
    stage = Stage()
    stage.in_cloud()
    stage.by_hand(Site.CLOUD)
    join = stage.cut()
    stage.lost(0.2, "the loss is noticed")
    stage.run(0.05)
    join()
    stage.always(lambda: stage.phase is not Phase.TO_CLOUD, 0.9, "hold-down: no attempt within a second of a loss")
    stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is used again")


def deaf_cloud() -> None:
    """A cut of the direction to the cloud alone is noticed within the echo limit, whatever the cloud still says."""
    stage = Stage(outputs=UNRATED)
    stage.in_cloud()
    stage.cut("up")
    stage.lost(stage.scenario.settings.echo_limit_s + 2 * DELIVERY_S, "late echoes are a loss")


def bare_beats() -> None:
    """Beats without content prove nothing: the loss is noticed a loss timeout after the last good one."""
    stage = Stage()
    stage.in_cloud()
    stage.cloud.pulse.bare = 1
    stage.lost(0.15, "bare beats are a loss")


def repeated_beats() -> None:
    """Repetitions of the last beats before a cut do not put off its notice."""
    stage = Stage()
    stage.in_cloud()
    stage.run(0.1)
    last = stage.cloud.pulse.last
    assert last is not None
    stage.cut()
    for number in range(20):
        stage.world.after(0.01 * number, stage.robot.pulse.deliver, stage.robot.pulse.hear, last, stage.now)
    stage.lost(0.105, "a repeated beat is no beat")


def sequence_starts_anew() -> None:
    """A pulse process that restarts is heard at once, although its sequence starts anew."""
    stage = Stage()
    stage.in_cloud()
    stage.cloud.pulse.kill(0.02)
    stage.run(0.4)
    heard_s = stage.machine.link.heard_s
    stage.expect(heard_s is not None and stage.robot.host.now_s() - heard_s < 0.06, "the cloud is heard")


def silent_data_session() -> None:
    """A data session that dies alone ends the stay in the cloud, also with no rated output and no required input."""
    stage = Stage(outputs=UNRATED, inputs=(InputPlan("scan"),), input_periods_s=(0.05,))
    stage.in_cloud()
    stage.cut(sessions="data")
    stage.lost(0.75, "the data session is judged")


def probes_of_another_cloud() -> None:
    """While pulse and data show different clouds the cloud is not used."""
    stage = Stage()
    stage.start()
    stage.cut("down", "data")
    process = stage.robot.data.process

    def strange() -> None:
        process.arrived("probe", b"-", probe.encode(probe.Probe("ee" * 16)))
        stage.world.after(0.1, strange)

    strange()
    stage.always(lambda: stage.phase in (Phase.ROBOT, Phase.TAKEOVER), 3.0, "data shows another cloud than the pulse")


def slow_link() -> None:
    """A loop that is too slow is not worth it: the policy stays on the robot."""
    stage = Stage(delay_s=0.045)
    stage.start()
    stage.always(lambda: stage.phase is not Phase.CLOUD, 6.0, "the link is too slow for the cloud")


def dwell() -> None:
    """A link that only gets slow does not end a stay before `min_dwell_s`."""
    stage = Stage(settings=Settings(min_dwell_s=3.0, hold_down_initial_s=1.0))
    stage.in_cloud()
    charged_s = stage.now - 0.5
    for wire in (stage.link.pulse.up, stage.link.pulse.down):
        wire.extra_s += 0.030
    stage.always(lambda: stage.phase is Phase.CLOUD, charged_s + 2.9 - stage.now, "min_dwell holds")
    stage.until(lambda: stage.site is Site.ROBOT, 3.0, "the policy leaves after the dwell")


def overdue_echoes() -> None:
    """While echoes are overdue the link does not sustain the cloud."""
    stage = Stage()
    stage.start()
    stage.run(0.1)
    stage.pin(Site.ROBOT)
    stage.run(2.0)
    stage.expect(stage.robot.control.process.sustained() == 1, "the link sustains the cloud")
    stage.cut("up")
    stage.run(0.5)
    stage.expect(stage.robot.control.process.sustained() == 0, "overdue echoes count as latency")


def hold_time() -> None:
    """The time for which the other side held a beat is no latency."""
    stage = Stage(jitter_s=0.0001)
    stage.start()
    stage.run(2.0)
    longest_s = 0.0
    for _ in range(50):
        stage.run(0.02)
        longest_s = max(longest_s, stage.machine.link.round_trip_s or 0.0)
    stage.expect(longest_s < 2 * stage.scenario.delay_s + 0.004, f"round trip {longest_s * 1e3:.1f} ms")


def echo_from_the_future() -> None:
    """An echo of a beat that was not sent yet gives no round trip."""
    stage = Stage()
    stage.start()
    stage.run(2.0)
    last = stage.cloud.pulse.last
    assert last is not None
    assert last.echo is not None
    echo = Echo(last.echo.incarnation, last.echo.sequence, last.echo.sent_us + 30_000_000, 0)
    lie = replace(last, echo=echo, sent_us=last.sent_us + 100, sequence=last.sequence + 1)
    stage.robot.pulse.deliver(stage.robot.pulse.hear, lie, stage.now)
    stage.always(lambda: (stage.machine.link.round_trip_s or 0.0) >= 0, 0.01, "no negative round trip")


def late_copies() -> None:
    """Late and doubled copies of a beat change nothing, also when the pulse process has forgotten the first."""
    stage = Stage()
    stage.in_cloud()
    heard: list[Beat] = []
    seen = stage.seen.cloud_beat

    def keep(beat: Beat, arrived_s: float) -> None:
        heard.append(beat)
        seen(beat, arrived_s)

    stage.seen.cloud_beat = keep  # type: ignore[method-assign]
    stage.run(0.5)
    stage.robot.pulse.kill(0.01)
    stage.link.pulse.down.cut_lost += 1  # the copies come before any new beat
    stage.run(0.03)
    before, report = stage.machine.link, stage.machine.situation.report
    stage.expect(before.received > 20, "beats have been counted")
    for copied in (heard[-15], heard[-1], heard[-1]):
        stage.robot.pulse.hear(copied, stage.now)
        stage.run(0.002)
        stage.expect(stage.machine.link == before, "a copy of a beat is no news")
        stage.expect(stage.machine.situation.report is report, "what a copy reports is past")
    stage.link.pulse.down.cut_lost -= 1


def apart_clocks() -> None:
    """System clocks that differ are a veto: the robot acts, and the cloud cannot be had by hand."""
    stage = Stage()
    stage.in_cloud()
    stage.cloud.host.wall_us += 500_000
    stage.until(lambda: stage.site is Site.ROBOT, 6.0, "clocks that differ are a veto")
    stage.run(0.5)
    stage.expect(not stage.by_hand(Site.CLOUD), "clocks that differ refuse the cloud by hand")


def paused_virtual_machine() -> None:
    """A cloud whose virtual machine was paused, its steady clock with it, is used again as after any loss."""
    for number in range(12):
        stage = Stage(f"story {number}")
        stage.in_cloud()
        stage.cloud.host.stand(1.0)
        stage.lost(0.2, "a paused cloud")
        stage.until(lambda s=stage: s.site is Site.CLOUD, 3.0, "the clocks agree, whatever stood still")  # type: ignore[misc]


STORIES = (
    first_command_after_a_cut,
    beats_in_step,
    beats_after_a_pause,
    hold_down_after_a_loss,
    deaf_cloud,
    bare_beats,
    repeated_beats,
    sequence_starts_anew,
    silent_data_session,
    probes_of_another_cloud,
    slow_link,
    dwell,
    overdue_echoes,
    hold_time,
    echo_from_the_future,
    late_copies,
    apart_clocks,
    paused_virtual_machine,
)
