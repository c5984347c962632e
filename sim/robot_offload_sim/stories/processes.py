"""Stories of the agent's processes: killed, stopped or starved alone, what waits in their queues, what they renew."""

from __future__ import annotations

from robot_offload_core.control.robot.placement import SwitchByHand
from robot_offload_core.data.process import InputPlan
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.topics.pauses import LIMIT_S
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.settings import NodeSpec, OutputSpec, Settings
from robot_offload_sim.stories.stage import ARM, CONTROLLER, STRANGER, Stage
from robot_offload_sim.world.ports import Sensed
from robot_offload_sim.world.scenario import Replica

NEWEST = 10**17
"""A sequence beyond those that the robot of a story has sent."""


def silent_cloud_control() -> None:
    """A cloud control that stops is noticed a loss timeout after its last word, although its pulse goes on."""
    stage = Stage()
    stage.in_cloud()
    stage.stall(stage.cloud.control, 1.0)
    stage.lost(0.09 + 0.03 + 0.02, "a silent control in the cloud")


def hung_collector() -> None:
    """A collector that hangs: nothing reaches the wheels, so the driver is inhibited, whoever is in charge."""
    for in_cloud in (True, False):
        stage = Stage()
        if in_cloud:
            stage.in_cloud()
        else:
            stage.start(cloud=False)
            stage.robot_acts()
            stage.run(1.0)
        stage.stall(stage.robot.collector, 3.0)
        lease_s = stage.scenario.settings.lease_s
        stage.until_inhibited(2 * lease_s + 0.5, "a hung collector stops the driver")


def long_stall_of_control() -> None:
    """A control that stood still while the link went takes over once a lease has passed since the last good beat."""
    stage = Stage(outputs=(OutputSpec("cmd_vel", 0.0),))  # the collector has nothing to report
    stage.in_cloud()
    stage.pin(Site.CLOUD)
    stage.cut()
    stage.stall(stage.robot.control, 0.2)
    stage.run(0.201)
    stage.until(lambda: stage.site is Site.ROBOT, 0.07, "control takes over after its own stall")


def stall_on_old_news() -> None:
    """After a stall of its own control begins nothing on news from before it."""
    for number in range(4):
        stage = Stage(f"story {number}", settings=Settings(prefer=Site.ROBOT))
        stage.start()
        stage.run(2.5)
        control = stage.robot.control
        before = len(stage.seen.decisions)
        stage.stall(control, 0.3)
        stage.world.after(0.05, stage.cut)
        stage.world.after(0.2, control.deliver, control.step, SwitchByHand(Site.CLOUD))
        stage.run(1.3)
        begun = [d for _, d in stage.seen.decisions[before:] if d.phase is Phase.TO_CLOUD]
        stage.expect(not begun, "an attempt was begun on old news")


def short_stall_of_control() -> None:
    """A stall of control alone is nobody's silence: no loss, no inhibit."""
    stage = Stage()
    stage.in_cloud()
    for _ in range(5):
        stage.stall(stage.robot.control, 0.12)
        stage.always(lambda: stage.site is Site.CLOUD and not stage.driver.inhibited, 0.5, "a stall of control's own")


def reported_in_a_stall() -> None:
    """What the collector reported while control stood still is judged at once; only silence gets a grace."""
    stage = Stage()
    stage.in_cloud()
    stage.hush("cloud")
    stage.stall(stage.robot.control, 0.24)
    stage.run(0.241)
    stage.until(lambda: stage.site is Site.ROBOT, 0.03, "a reported fault waits for no grace")


def starved_control_and_a_cut() -> None:
    """The same when the link is cut: the grace for a stall of its own ends."""
    for off_s in (0.052, 0.12, 0.2):
        stage = Stage(outputs=(OutputSpec("cmd_vel", 0.0),))
        stage.in_cloud()
        stage.pin(Site.CLOUD)
        stage.starve(stage.robot.control, off_s, 0.010, 8.0)
        stage.run(1.0)
        stage.cut()
        lease_s = stage.scenario.settings.lease_s
        stage.until(lambda s=stage: s.site is Site.ROBOT, 2 * lease_s + 0.3, "a starved control takes over")  # type: ignore[misc]


def starved_collector() -> None:
    """A collector that gets its processor in slices still notices that the robot is silent."""
    stage = Stage()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.0)
    stage.starve(stage.robot.collector, 0.125, 0.010, 8.0)
    stage.run(0.5)
    stage.hush("robot")
    stage.until_inhibited(1.5, "a starved collector notices silence")


def starved_collector_after_a_cut() -> None:
    """A collector that gets slices from a cut on: the robot's silence is noticed within its bound (3b)."""
    for number in range(8):
        stage = Stage(f"story {number}")
        stage.in_cloud()
        stage.cut()
        stage.lost(0.2, "the loss")
        stage.starve(stage.robot.collector, 0.16 + 0.01 * number, 0.012, 2.0)
        stage.run(2.0)


def loss_to_the_millisecond() -> None:
    """A loss is noticed when it is certain, not at the next turn or report."""
    for number in range(6):
        stage = Stage(f"story {number}", tick_s=0.03)
        stage.in_cloud()
        stage.cut()
        stage.lost(0.2, "the loss")
        late_s = stage.now - stage.seen.good_s - stage.scenario.settings.loss_timeout_s
        stage.expect(late_s < 0.005, f"noticed {late_s * 1e3:.1f} ms late")


def queues_after_a_pause() -> None:
    """What waited in the queue of a stopped collector or egress is not passed on as new."""
    stage = Stage()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.0)
    stage.stall(stage.robot.collector, 0.4)
    stage.run(1.0)
    oldest_s = max(m.at_s - m.born_s for m in stage.seen.messages)
    stage.expect(oldest_s < 0.15, f"a message of {oldest_s * 1e3:.0f} ms passed as new")
    patient = Settings(lease_s=2.0, max_command_age_s=0.6)
    stage = Stage(settings=patient, cloud_settings=patient, outputs=(OutputSpec("cmd_vel", 0.5),))
    stage.in_cloud()
    stage.stall(stage.cloud.data, 0.3)
    stage.run(1.0)
    oldest_s = max(m.at_s - m.born_s for m in stage.seen.messages if m.site is Site.CLOUD)
    stage.expect(oldest_s < 0.15, f"a message of {oldest_s * 1e3:.0f} ms left as new")


def messages_that_waited_for_the_egress() -> None:
    """What waited for the egress for less than a pause is as old as it is when it comes to the robot."""
    strict = Settings(max_command_age_s=0.09)
    stage = Stage(settings=strict, cloud_settings=strict)
    stage.in_cloud()
    for _ in range(10):
        stage.stall(stage.cloud.data, 0.9 * LIMIT_S)
        stage.run(0.5)
    oldest_s = max(m.at_s - m.born_s for m in stage.seen.messages if m.site is Site.CLOUD)
    stage.expect(oldest_s < 0.093, f"a message of {oldest_s * 1e3:.0f} ms passed as new")
    stale = stage.robot.collector.process.counters["cmd_vel.cloud.Stale"]
    stage.expect(stale > 0, "what waited is left out")


def inputs_after_a_pause() -> None:
    """Inputs that waited in the queue of a stopped data process are not sent as new."""
    stage = Stage()
    ages: list[float] = []
    stage.seen.input_heard = lambda name, age_s: ages.append(age_s)  # type: ignore[method-assign]
    stage.in_cloud()
    stage.expect(len(ages) > 5, "inputs reach the replicas")
    waited: list[int] = []
    stage.stall(stage.robot.data, 0.4)
    stage.run(0.42)
    waited.append(stage.robot.data.process.counters["scan.waited"])
    stage.expect(waited[0] > 0, "what waited is left out")


def inputs_that_waited() -> None:
    """What waited for the robot's data process for less than a pause is as old as it is at the replicas."""
    stage = Stage(inputs=(InputPlan("scan", 90), InputPlan("map", latched=True)))
    stage.in_cloud()
    for _ in range(10):
        stage.stall(stage.robot.data, 0.9 * LIMIT_S)
        stage.run(0.5)
    stage.expect(stage.cloud.data.process.counters["scan.too_old"] > 0, "what waited is left out")


def old_inputs() -> None:
    """An input that is older than its limit when it arrives does not reach the replicas, nor one of another robot."""
    stage = Stage()
    heard: list[str] = []
    stage.seen.input_heard = lambda name, age_s: heard.append(name)  # type: ignore[method-assign]
    stage.in_cloud()
    stage.system.silent_inputs.append(0)
    stage.run(0.1)
    data, before = stage.cloud.data, len(heard)
    token = Token(stage.machine.incarnation, 0, stage.cloud.control.process.incarnation)
    now_us = round(stage.cloud.host.now_s() * 1e6)
    for robot, age_us in ((token.robot, 400_000), (STRANGER, 1_000)):
        header = envelope.encode(Envelope(Token(robot, 0, token.cloud), NEWEST, now_us - age_us))
        data.arrived("in/scan", header, Sensed(b"scan"))
    stage.expect(len(heard) == before, "an old or foreign input reached the replicas")
    header = envelope.encode(Envelope(token, NEWEST, now_us - 1_000))
    data.arrived("in/scan", header, Sensed(b"scan"))
    stage.expect(len(heard) == before + 1, "a fresh one does")
    data.arrived("in/scan", header, Sensed(b"scan"))
    stage.expect(len(heard) == before + 1, "the same input reached the replicas twice")


def many_inputs() -> None:
    """An input with a highest rate is thinned out."""
    stage = Stage(inputs=(InputPlan("scan", 300, 10.0), InputPlan("map", latched=True)), input_periods_s=(0.01, 60.0))
    heard: list[str] = []
    stage.seen.input_heard = lambda name, age_s: heard.append(name)  # type: ignore[method-assign]
    stage.in_cloud()
    before = heard.count("scan")
    stage.run(2.0)
    count = heard.count("scan") - before
    stage.expect(15 <= count <= 26, f"{count} messages in 2 s at 10 Hz")


def latched_input() -> None:
    """The cloud is not used before it holds the latched inputs, and gets them again after a restart."""
    stage = Stage()
    stage.start()
    stage.until(lambda: stage.phase is Phase.CLOUD, 8.0, "the cloud is in charge")
    stage.expect(bool(stage.cloud.data.process.latched["map"]), "with the map")
    stage.cloud.data.kill(0.05)
    stage.run(0.06)
    stage.until(lambda: bool(stage.cloud.data.process.latched["map"]), 3.0, "a new process gets the map again")
    stage.until(lambda: stage.phase is Phase.CLOUD, 12.0, "and the cloud is used again")


def map_that_changes() -> None:
    """A latched input that changes while the cloud acts ends no stay, and the replicas get it; also a big one."""
    for held_s in (0.0, 1.2):
        stage = Stage(input_periods_s=(0.05, 2.0))
        stage.in_cloud()
        process = stage.cloud.data.process
        before = process.latched["map"]
        wire = stage.link.data.up
        target, arrived = wire.target

        def late(channel: str, *rest: object, of: object = stage, by_s: float = held_s, to: object = arrived) -> None:
            assert isinstance(of, Stage)
            assert callable(to)
            of.world.after(by_s if channel == "in/map" else 0.0, to, channel, *rest)

        wire.target = target, late
        if not held_s:
            stage.until(lambda p=process, b=before: p.latched["map"] != b, 3.0, "a new map arrives")  # type: ignore[misc]
            stage.until(process.complete, 0.2, "the cloud knows that it holds the robot's map without another one")
        stage.always(lambda s=stage: s.phase is Phase.CLOUD, 7.0, "a new map ends the stay")  # type: ignore[misc]
        stage.expect(process.latched["map"] != before and len(process.latched["map"]) == 1, "the new map is held alone")


def missing_map() -> None:
    """Without the latched input the cloud is not ready."""
    stage = Stage()
    process = stage.cloud.data
    arrived = process.arrived

    def deaf(channel: str, header: bytes, payload: object) -> None:
        if channel != "in/map":
            arrived(channel, header, payload)

    stage.link.data.up.target = process, deaf
    stage.start()
    stage.always(lambda: stage.phase is not Phase.CLOUD, 4.0, "the cloud is used without the map")


def restarted_data() -> None:
    """A data process that restarts on either side is told everything it needs: the cloud is used again."""
    for side in ("robot", "cloud"):
        stage = Stage()
        stage.in_cloud()
        getattr(stage, side).data.kill(0.05)
        stage.run(1.0)
        stage.until_phase(Phase.CLOUD, 12.0, f"after a restart of the {side}'s data")
        stage.run(0.5)
        stage.expect(stage.phase is Phase.CLOUD, "for good")


def restarted_data_on_a_robot_that_stays() -> None:
    """A data process that restarts hears again who its control is, although nothing changes."""
    stage = Stage()
    stage.start()
    stage.run(0.1)
    stage.pin(Site.ROBOT)
    stage.run(1.0)
    stage.robot.data.kill(0.05)
    stage.run(1.0)
    stage.expect(stage.robot.data.process.orders.incarnation == stage.machine.incarnation, "it knows its control")


def consumers_in_the_cloud() -> None:
    """Consumers in the cloud hear the side in charge, the robot's messages too."""
    stage = Stage()
    stage.start()
    stage.run(0.1)
    stage.pin(Site.ROBOT)
    stage.run(2.0)
    heard = {m.site for m in stage.seen.in_cloud}
    stage.expect(heard == {Site.ROBOT}, f"heard {sorted(heard)} while the robot acts")
    stage.pin(None)
    stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is in charge")
    stage.run(0.3)
    since_s = stage.now
    stage.run(0.5)
    late = {m.site for m in stage.seen.in_cloud if m.at_s > since_s}
    stage.expect(late == {Site.CLOUD}, "and the cloud while it acts")


def one_side_in_the_cloud() -> None:
    """Consumers in the cloud never hear an older stay again, though the robot's messages come late and twice (9)."""
    stage = Stage()
    stage.start()
    stage.link.data.up.doubled = 0.9
    stage.run(0.1)
    stage.pin(Site.ROBOT)
    stage.run(2.0)
    stage.pin(None)
    stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is in charge")
    stage.run(3.0)


def nothing_is_lost() -> None:
    """With several outputs nothing is lost at a commanded changeover: what was held passes with it."""
    stage = Stage(
        nodes=(CONTROLLER, ARM, NodeSpec("planner", core=True)),
        outputs=(OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 0.2), OutputSpec("plan", 0.0)),
        replicas={"controller": Replica(0, 0.05), "arm": Replica(1, 0.05), "planner": Replica(2, 0.05)},
    )  # fmt: skip
    stage.seen.quiet_s = lambda: 1e9
    stage.in_cloud()
    for site in (Site.ROBOT, Site.CLOUD) * 5:
        start_s = stage.now
        stage.by_hand(site)
        stage.run(0.7)
        for index in range(3):
            gap_s = stage.longest_gap(start_s, index)
            stage.expect(gap_s < 0.09, f"a gap of {gap_s * 1e3:.0f} ms on output {index}")


def nothing_to_wait_for() -> None:
    """With no node that both sides have, readiness is known from the start: no switching to and fro."""
    stage = Stage(nodes=(), replicas={}, outputs=())
    stage.start()
    stage.run(6.0)
    switches = sum(d.switched for _, d in stage.seen.decisions)
    begun = sum(d.phase is Phase.TO_CLOUD for _, d in stage.seen.decisions)
    stage.expect(stage.machine.nodes_ready, "the robot is ready")
    stage.expect(switches <= 1 and begun <= 1, f"{switches} switches, {begun} attempts in 6 s")


def replicas_missing() -> None:
    """A replica that the connected cloud does not see is reported after a while, and not before."""
    stage = Stage()
    stage.start()
    stage.run(2.0)
    process = stage.robot.control.process
    stage.expect(process.missing_replicas() is None, "nothing is missing")
    stage.cloud.nodes["planner"].kill(1e9)
    end_s = stage.now + 8.0
    while stage.now < end_s and process.missing_replicas() is None:
        stage.run(0.5)
    stage.expect(process.missing_replicas() is not None, "a missing replica is reported")


STORIES = (
    silent_cloud_control,
    hung_collector,
    long_stall_of_control,
    stall_on_old_news,
    short_stall_of_control,
    reported_in_a_stall,
    starved_control_and_a_cut,
    starved_collector,
    starved_collector_after_a_cut,
    loss_to_the_millisecond,
    queues_after_a_pause,
    messages_that_waited_for_the_egress,
    inputs_after_a_pause,
    inputs_that_waited,
    old_inputs,
    many_inputs,
    latched_input,
    map_that_changes,
    missing_map,
    restarted_data,
    restarted_data_on_a_robot_that_stays,
    consumers_in_the_cloud,
    one_side_in_the_cloud,
    nothing_is_lost,
    nothing_to_wait_for,
    replicas_missing,
)
