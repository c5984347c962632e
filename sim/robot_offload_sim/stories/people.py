"""Stories of people: switches by hand on either side, pins, settings that change, and pods that go."""

from __future__ import annotations

from dataclasses import replace

from robot_offload_core.control.robot import placement
from robot_offload_core.data import probe
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import Mode, OutputSpec, Settings
from robot_offload_sim.promises.promises import RIVAL_S
from robot_offload_sim.stories.stage import ARM, CONTROLLER, Stage
from robot_offload_sim.world.scenario import Replica

SWITCH_S = 1.0


def there_and_back() -> None:
    """A switch by hand is obeyed in both directions, without a gap, and the resting side's nodes rest."""
    stage = Stage(
        nodes=(CONTROLLER, ARM), outputs=(OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 0.2)),
        replicas={"controller": Replica(0, 0.05), "arm": Replica(1, 0.05)},
    )  # fmt: skip
    stage.in_cloud()
    for _ in range(3):
        stage.expect(not stage.active("robot"), "the robot's node rests while the cloud acts")
        start_s = stage.now
        stage.expect(stage.by_hand(Site.ROBOT), "the robot can be had by hand")
        stage.until(lambda: stage.phase is Phase.ROBOT, SWITCH_S, "the robot acts as asked")
        stage.run(0.4)
        stage.expect(stage.phase is Phase.ROBOT, "the robot goes on as asked")
        stage.expect(not stage.active("cloud"), "the cloud's node rests while the robot acts")
        stage.expect(stage.by_hand(Site.CLOUD), "the cloud can be had by hand")
        stage.until(lambda: stage.phase is Phase.CLOUD, SWITCH_S, "the cloud acts as asked")
        stage.run(0.4)
        for index in (0, 1):
            gap_s = stage.longest_gap(start_s, index)
            stage.expect(gap_s < 0.075, f"a gap of {gap_s * 1e3:.0f} ms on output {index}")
    stage.expect(stage.seen.changeovers["sudden"] == 0, "all changeovers were commanded")


def pinned() -> None:
    """A pin on the robot is obeyed in both directions and outweighs a switch by hand."""
    stage = Stage()
    stage.in_cloud()
    stage.pin(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.ROBOT, SWITCH_S, "pinned to the robot")
    stage.expect(not stage.by_hand(Site.CLOUD), "the pin refuses the cloud by hand")
    stage.always(lambda: stage.phase is Phase.ROBOT, 3.0, "the pin holds")
    stage.pin(Site.CLOUD)
    stage.until(lambda: stage.phase is Phase.CLOUD, SWITCH_S, "pinned to the cloud")


def asked_while_cut() -> None:
    """The cloud cannot be had by hand once nothing was heard of it for a loss timeout."""
    for silent_s in (0.12, 0.5):
        stage = Stage(settings=Settings(prefer=Site.ROBOT))
        stage.start()
        stage.run(2.5)
        stage.cut()
        stage.run(silent_s)
        stage.expect(not stage.by_hand(Site.CLOUD), "refused while the link is cut")


def asked_in_the_cloud() -> None:
    """A switch asked for in the cloud is decided by the robot and answered in the cloud; nonsense is refused."""
    stage = Stage()
    stage.in_cloud()
    stage.cloud.control.process.ask(Site.ROBOT, 7)
    stage.until(lambda: stage.phase is Phase.ROBOT, SWITCH_S, "the robot acts as asked in the cloud")
    stage.until(lambda: stage.answered(7, True), 1.0, "the cloud hears the answer")
    stage.run(0.3)
    stage.by_hand(Site.CLOUD)
    stage.until(lambda: stage.phase is Phase.CLOUD, SWITCH_S, "the cloud acts as asked later, on the robot")
    stage.always(lambda: stage.phase is Phase.CLOUD, 0.5, "the earlier request is not carried out again")
    stage.cloud.control.process.ask(Site.CLOUD, 8)
    process = stage.cloud.control.process
    process.request = process.request.replace("cloud", "edge")
    stage.until(lambda: stage.answered(8, False), 1.5, "nonsense is refused")


def request_over_a_lossy_link() -> None:
    """A switch asked for in the cloud reaches the robot although the first probes with it are lost."""
    stage = Stage()
    stage.in_cloud()
    wire = stage.link.data.down
    target, arrived = wire.target
    lost: list[bytes] = []

    def lossy(channel: str, header: bytes, payload: bytes) -> None:
        if channel == "probe" and len(lost) < 2 and isinstance(probe.decode(payload), probe.Probe):
            lost.append(payload)
        else:
            arrived(channel, header, payload)

    wire.target = target, lossy
    stage.cloud.control.process.ask(Site.ROBOT, 7)
    stage.until(lambda: stage.answered(7, True), 0.9, "the robot hears the request")
    stage.expect(len(lost) == 2, "probes with it were lost")


def unheard_request() -> None:
    """A switch asked for in the cloud is refused when the robot does not answer."""
    stage = Stage()
    stage.in_cloud()
    stage.cut()
    stage.cloud.control.process.ask(Site.ROBOT, 9)
    stage.until(lambda: stage.answered(9, False), 2.5, "an unheard request is refused")


def pods_that_go() -> None:
    """A cloud that announces its end is left in order, and not chosen again."""
    stage = Stage()
    stage.in_cloud()
    stage.cloud.control.announce("pod-1")
    stage.until(lambda: stage.phase is Phase.ROBOT, 1.5, "the robot takes over before the pods go")
    stage.expect(stage.seen.changeovers["sudden"] == 0, "in order")
    stage.always(lambda: stage.phase is Phase.ROBOT, 4.0, "a cloud that goes is not chosen again")


def shorter_lease() -> None:
    """A lease that becomes shorter at run time: effects still wait for the end of what was granted before."""
    long = Settings(lease_s=2.0)
    stage = Stage(settings=long, cloud_settings=long)
    stage.in_cloud()
    stage.robot.control.adopt(replace(long, lease_s=0.25))
    stage.run(0.2)
    stage.cut("down")
    stage.lost(0.3, "the loss is noticed")
    stage.run(2.5)


def observing() -> None:
    """An agent that changes to Observe hands over to the robot first, and never switches then."""
    stage = Stage()
    stage.in_cloud()
    stage.robot.control.adopt(replace(stage.scenario.settings, mode=Mode.OBSERVE))
    stage.until(lambda: stage.phase is Phase.ROBOT, SWITCH_S, "the robot acts before it only observes")
    stage.run(0.5)
    stage.expect(not stage.by_hand(Site.CLOUD), "an observer refuses switches")
    stage.always(lambda: stage.phase is Phase.ROBOT, 3.0, "an observer never switches")


def shorter_limits() -> None:
    """Limits that change at run time reach the collector, also one that starts later."""
    stage = Stage()
    stage.in_cloud()
    stage.robot.control.adopt(replace(stage.scenario.settings, max_command_age_s=0.12))
    stage.robot.collector.kill(0.05)
    stage.run(1.5)
    stage.expect(stage.robot.collector.state.max_age_s == 0.12, "the new limit holds")


def change_of_mind() -> None:
    """A person asks for the robot while its nodes still go to sleep: no gap."""
    stage = Stage(nodes=(CONTROLLER,))
    stage.in_cloud()
    stage.by_hand(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.ROBOT, SWITCH_S, "the robot acts")
    stage.run(0.5)
    for node in stage.robot.nodes.values():
        node.slow_s = 0.15
    start_s = stage.now
    stage.by_hand(Site.CLOUD)
    stage.until(lambda: stage.phase is Phase.CLOUD, SWITCH_S, "the cloud acts")
    stage.run(0.01)
    stage.by_hand(Site.ROBOT)
    stage.run(1.5)
    stage.expect(stage.phase is Phase.ROBOT, "the robot acts as asked last")
    stage.expect(stage.longest_gap(start_s) < 0.1, f"a gap of {stage.longest_gap(start_s) * 1e3:.0f} ms")


def other_parameters() -> None:
    """Parameters that differ between the replicas end no stay and keep the policy from the next; a person waits."""
    stage = Stage()
    stage.in_cloud()
    message = "Parameters differ between the two replicas of controller (speed)"
    differ = placement.Vetoed("parameters", (placement.Veto(Reason.REPLICA_PARAMETERS_DIFFER, message),))
    control = stage.robot.control
    control.step(differ)
    stage.always(lambda: stage.phase is Phase.CLOUD, 2.0, "a stay goes on")
    mend = stage.cut()
    stage.until(lambda: stage.phase is Phase.ROBOT, SWITCH_S, "the link is lost")
    mend()
    stage.always(lambda: stage.phase is Phase.ROBOT, 5.0, "the policy waits for equal parameters")
    stage.expect(stage.by_hand(Site.CLOUD), "a person gets the cloud")
    patience_s = control.robot.settings.preparing_s
    stage.always(lambda: stage.phase is not Phase.CLOUD, patience_s - 0.05, "and waits as long as nodes may take")
    stage.until(lambda: stage.phase is Phase.CLOUD, SWITCH_S, "then the cloud acts")


def second_publisher() -> None:
    """A second publisher of the wheels' topic keeps the cloud out, with `strict` it stops the wheels; until it goes."""
    for strict in (False, True):
        stage = Stage(strict=strict, worlds=("second publisher",))
        stage.in_cloud()
        stage.system.rivals.append("intruder")
        stage.until(lambda s=stage: s.site is Site.ROBOT, 3.0, "the robot acts beside a second publisher")  # type: ignore[misc]
        if strict:
            stage.until_inhibited(1.0, "strict: the wheels stand")
        stage.always(lambda s=stage: s.site is Site.ROBOT, 3.0, "and stays in charge")  # type: ignore[misc]
        stage.system.rivals.clear()
        stage.until(lambda s=stage: s.site is Site.CLOUD and not s.driver.inhibited, 6.0, "until it has gone")  # type: ignore[misc]


def second_publisher_unobeyed() -> None:
    """A robot whose node is dead takes over when a second publisher appears: two are worse than wheels that stand."""
    stage = Stage(worlds=("second publisher",))
    stage.in_cloud()
    stage.robot.nodes["controller"].kill(1e9)
    stage.run(1.0)
    stage.expect(stage.site is Site.CLOUD, "the cloud goes on without the robot's node")
    stage.system.rivals.append("intruder")
    stage.until(lambda: stage.site is Site.ROBOT, RIVAL_S, "the robot is in charge although it cannot act")
    stage.until_inhibited(1.0, "the wheels stand")
    stage.always(lambda: stage.site is Site.ROBOT and stage.driver.inhibited, 5.0, "for as long as there are two")
    stage.system.rivals.clear()
    stage.until(lambda: stage.site is Site.CLOUD and not stage.driver.inhibited, 8.0, "until it has gone")


def two_replicas() -> None:
    """Two processes of one node in the cloud take it away; with `strict` two on the robot stop the wheels."""
    twice = [(Reason.TWO_REPLICAS.value, "/robot/cmd_vel is published by 2 processes (/controller, /controller)")]
    stage = Stage(strict=True)
    stage.in_cloud()
    control = stage.robot.control.process
    collector = stage.robot.collector.process
    collector.twins(0, ["/controller", "/controller"])
    stage.always(lambda: stage.phase is Phase.CLOUD and not stage.driver.inhibited, 2.0, "the cloud goes on alone")
    stage.expect(stage.by_hand(Site.ROBOT), "a person asks for the robot")
    stage.until_inhibited(2.0, "strict: the wheels stand while the robot acts")
    collector.twins(0, [])
    stage.until(lambda: not stage.driver.inhibited, 2.0, "until one of the two is gone")
    stage.expect(stage.by_hand(Site.CLOUD), "a person asks for the cloud")
    stage.until(lambda: stage.phase is Phase.CLOUD, 4.0, "the cloud acts")
    control.veto("cloud", twice)
    stage.until(lambda: stage.site is Site.ROBOT, RIVAL_S, "two in the cloud take it away")


STORIES = (
    two_replicas,
    second_publisher,
    second_publisher_unobeyed,
    there_and_back,
    pinned,
    asked_while_cut,
    asked_in_the_cloud,
    request_over_a_lossy_link,
    unheard_request,
    pods_that_go,
    shorter_lease,
    observing,
    shorter_limits,
    change_of_mind,
    other_parameters,
)
