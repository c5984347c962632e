"""Stories of the gate: what passes the collector at a changeover, after a fallback and over its restarts."""

from __future__ import annotations

from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.messages import ENVELOPE, Carried, CloudTypes, SetGate
from robot_offload_core.words.settings import NodeSpec, OutputSpec, Settings
from robot_offload_sim.sides.shells import TYPE
from robot_offload_sim.stories.stage import ARM, CONTROLLER, STRANGER, Stage
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload
from robot_offload_sim.world.scenario import Replica


def _offer(stage: Stage, index: int, sequence: int, *, ahead_s: float = -0.002, token: Token | None = None) -> None:
    """Offer a message of the cloud to the collector, under the present token unless another one is given."""
    collector = stage.robot.collector
    charge = collector.state.next or collector.state.charge
    assert charge is not None
    echo_us = round((stage.robot.host.now_s() + ahead_s) * 1e6)
    header = envelope.encode(Envelope(token or charge.token, sequence, echo_us))
    payload = Payload(Site.CLOUD, Message("cloud/controller", 1, sequence, stage.now), header, stage.now)
    collector.take(Carried(ENVELOPE, index, header, payload))


def doubled_messages() -> None:
    """Every message of the cloud arrives twice or more, across changeovers: none passes twice (1b)."""
    stage = Stage(nodes=(CONTROLLER, ARM), outputs=(OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 0.2)),
                  replicas={"controller": Replica(0, 0.05), "arm": Replica(1, 0.05)})  # fmt: skip
    wire, heard = stage.link.data.down, []
    data, arrived = wire.target

    def listen(*message: object) -> None:
        heard.append(message)
        arrived(*message)

    wire.target = data, listen
    stage.start()
    wire.doubled = 1.0
    stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is in charge")
    for message in heard[-10:]:  # also those that waited for the changeover
        arrived(*message)
    for _ in range(4):
        stage.run(0.4)
        stage.by_hand(Site.ROBOT)
        stage.run(0.5)
        stage.by_hand(Site.CLOUD)
    stage.run(0.5)


def repeated_next() -> None:
    """A repetition of what is held back for the changeover does not take the place of a newer one."""
    stage = Stage(nodes=(CONTROLLER, ARM), outputs=(OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 0.2)),
                  replicas={"controller": Replica(0, 0.05), "arm": Replica(1, 0.05)})  # fmt: skip
    stage.start()
    for name in ("controller", "arm"):
        stage.cloud.nodes[name].hung = 1
    stage.until(lambda: stage.robot.collector.state.next is not None, 6.0, "the changeover is offered")
    _offer(stage, 0, 1)
    _offer(stage, 0, 2)
    _offer(stage, 0, 1)
    _offer(stage, 1, 1)
    passed = stage.seen.lanes[0].last[Site.CLOUD].sequence
    stage.expect(passed == 2, f"message {passed} passed at the changeover instead of the newest")


def impossible_echo() -> None:
    """A message that echoes a beat of the future is ignored."""
    stage = Stage()
    stage.in_cloud()
    before = len(stage.seen.messages)
    _offer(stage, 0, 10_000, ahead_s=10.0)
    stage.expect(len(stage.seen.messages) == before, "an echo of the future passes")


def held_too_long() -> None:
    """What was held for the changeover passes with it only while it is no older than any message may be."""
    settings = Settings()
    stage = Stage(
        settings=settings, nodes=(CONTROLLER, NodeSpec("planner", core=True)),
        outputs=(OutputSpec("cmd_vel", 0.15), OutputSpec("plan", 0.0)),
        replicas={"controller": Replica(0, 0.05), "planner": Replica(1, 5.0)},
    )  # fmt: skip
    stage.start()
    stage.cloud.nodes["controller"].hung = 1
    stage.until(lambda: stage.robot.collector.state.next is not None, 6.0, "the changeover is offered")
    _offer(stage, 1, 1)
    stage.run(0.3)
    before = len(stage.seen.messages)
    _offer(stage, 0, 1)
    late = [m for m in stage.seen.messages[before:] if m.index == 1]
    stage.expect(not late, "a message held for longer than the age limit passes")


def earlier_control() -> None:
    """The gate of an earlier control, left in a queue, changes nothing; the same after a fallback."""
    stage = Stage()
    stage.in_cloud()
    collector = stage.robot.collector
    charge, started_us = collector.state.charge, collector.state.started_us
    assert charge is not None
    other = Charge(Site.ROBOT, Token(STRANGER, 9, ""))
    collector.take(SetGate(Gate(started_us - 5, other, None, stage.robot.host.now_s())))
    stage.expect(collector.state.charge == charge, "an earlier control is heard")


def fallback() -> None:
    """A collector that has fallen back passes the robot only, takes no effect, and needs a new epoch."""
    stage = Stage(hot=True)
    stage.in_cloud()
    stage.stall(stage.robot.control, 3.0)
    stall_s = stage.now
    collector = stage.robot.collector
    charge, started_us = collector.state.charge, collector.state.started_us
    assert charge is not None
    lease_s = stage.scenario.settings.lease_s
    stage.until(lambda: collector.state.fell_back, lease_s + 0.06, "control's silence is noticed")
    stage.until(
        lambda: stage.first_message(stall_s, Site.ROBOT) is not None,
        0.08,
        "a robot that is Hot passes after a fallback",
    )
    stage.run(0.2)
    admitted: list[Token] = []
    stage.seen.cloud_effect = admitted.append  # type: ignore[method-assign,assignment]
    collector.cloud_effect(charge.token)
    stage.expect(not admitted, "an effect of the cloud is admitted after a fallback")
    collector.take(SetGate(Gate(started_us, charge, None, stage.robot.host.now_s())))
    before = len(stage.seen.messages)
    _offer(stage, 0, 10**12, token=charge.token)
    stage.expect(len(stage.seen.messages) == before, "the epoch that the collector has left goes on")


def fallback_outlives_the_collector() -> None:
    """A collector that restarts after a fallback, control still silent, goes on passing the robot."""
    stage = Stage(hot=True)
    stage.in_cloud()
    stage.stall(stage.robot.control, 3.0)
    stage.until(lambda: stage.robot.collector.state.fell_back, 0.4, "fallen back")
    stage.run(0.3)
    stage.robot.collector.kill(0.02)
    stage.run(0.02)
    stage.until_heard(stage.now, Site.ROBOT, 0.12, "the robot passes at once")


def resumed_without_control() -> None:
    """A collector that restarts while control is silent passes no cloud message, and after a lease the robot."""
    stage = Stage(hot=True)
    stage.in_cloud()
    stage.stall(stage.robot.control, 2.0)
    stage.robot.collector.kill(0.02)
    stage.run(0.021)
    start_s = stage.now
    lease_s = stage.scenario.settings.lease_s
    stage.until_heard(start_s, Site.ROBOT, lease_s + 0.12, "the robot passes")
    heard = stage.first_message(start_s, Site.CLOUD)
    stage.expect(heard is None, "a cloud message passed before control had spoken")


def restarted_collector() -> None:
    """A collector that is killed passes nothing again that its predecessor may have passed (1a, 1b)."""
    stage = Stage()
    stage.in_cloud()
    collector = stage.robot.collector
    stage.deaf("collector", "control", 0.5)
    sequence = stage.seen.lanes[0].last[Site.CLOUD].sequence
    collector.kill(0.01)
    stage.run(0.011)
    stage.until(lambda: collector.state.gate_s is not None, 0.1, "control speaks to the new one")
    collector.take(CloudTypes((("cmd_vel", TYPE),)))  # without the type nothing passes anyway
    _offer(stage, 0, sequence + 1, ahead_s=-0.1)
    passed = [r for r in ("cmd_vel.cloud.passed",) if collector.process.counters[r]]
    stage.expect(collector.state.charge is not None, "it goes on where the last one was")
    stage.expect(not passed, "what was sent before the restart passes")


def unsaved_memory() -> None:
    """A collector that restarts while control is silent remembers the cloud's stay: no robot beside it."""
    stage = Stage(hot=True)
    stage.in_cloud()
    stage.deaf("control", "collector", 0.15)
    stage.robot.collector.kill(0.01)
    start_s = stage.now
    stage.run(0.1)
    stage.expect(stage.first_message(start_s, Site.ROBOT) is None, "the robot passes while the cloud is in charge")


def hot_robot_is_held_back() -> None:
    """A Hot robot's messages do not pass while the cloud acts (1a)."""
    stage = Stage(hot=True)
    stage.in_cloud()
    start_s = stage.now
    stage.run(1.0)
    stage.expect(stage.first_message(start_s, Site.ROBOT) is None, "both sides pass")


STORIES = (
    doubled_messages,
    repeated_next,
    impossible_echo,
    held_too_long,
    earlier_control,
    fallback,
    fallback_outlives_the_collector,
    resumed_without_control,
    restarted_collector,
    hot_robot_is_held_back,
    unsaved_memory,
)
