"""What the agents publish about themselves, by the names that other tools know."""

import json
from importlib.metadata import version

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Header, Int32, String

from robot_offload_core.fence.token import Site
from robot_offload_core.words import beats
from tests.ros.agent.ears import BEST_EFFORT, LATCHED, Ear
from tests.ros.agent.harness import World


def test_network_status_says_1_while_the_link_sustains_the_cloud_and_0_when_it_does_not(world: World) -> None:
    near = world.ear.hear(Int32, "/network_status", LATCHED)
    far = world.cloud_ear().hear(Int32, "/remote_network_status", LATCHED)
    world.until(lambda: near and near[-1][1].data == 1 and far and far[-1][1].data == 1, "1 on both sides")
    world.cut("both")
    world.until(lambda: near[-1][1].data == 0 and far[-1][1].data == 0, "0 on both sides")
    world.cut(None)
    world.until(lambda: near[-1][1].data == 1 and far[-1][1].data == 1, "1 again")


def test_beats_that_are_heard_are_mirrored_as_headers_that_decode(world: World) -> None:
    near = world.ear.hear(Header, "/connectivity_test_remote", BEST_EFFORT)
    far = world.cloud_ear().hear(Header, "/connectivity_test_local", BEST_EFFORT)
    world.until(lambda: len(near) > 20 and len(far) > 20, "mirrored beats")
    for heard, sender in ((near, Site.CLOUD), (far, Site.ROBOT)):
        told = [beats.decode(message.frame_id) for _, message in heard]
        assert {beat.sender for beat in told} == {sender}
        assert {beat.uid for beat in told} == {world.folder.name}
        sequences = [beat.sequence for beat in told]
        assert sequences == sorted(set(sequences))
        assert sequences[-1] - sequences[0] >= 3 * (len(sequences) - 1), "ten a second of fifty"
        assert heard[-1][1].stamp.sec > 1_600_000_000


def test_placement_is_latched_and_names_site_epoch_reason_and_time(world: World) -> None:
    heard = world.ear.hear(String, "/offload/placement", LATCHED)
    world.until(lambda: heard, "the latched placement")
    body = json.loads(heard[-1][1].data)
    assert set(body) >= {"site", "phase", "epoch", "reason", "message", "since_s", "silent_ms", "effects", "control"}
    assert (body["site"], body["phase"], body["effects"]) == ("cloud", "Cloud", "cloud")
    world.cut("both")
    world.goes_to("robot")
    lost = next(b for b in map(json.loads, (m.data for _, m in heard)) if b["epoch"] > body["epoch"])
    assert lost["silent_ms"] is None or lost["silent_ms"] > 100
    world.until(lambda: json.loads(heard[-1][1].data)["effects"] == "robot", "the robot's effects are admitted")


def test_diagnostics_show_link_placement_nodes_and_counters_of_both_sides(world: World) -> None:
    def complete(ear: Ear, *names: str) -> bool:
        return set(names) <= set(ear.diagnostics)

    far = world.cloud_ear()
    world.until(lambda: complete(world.ear, "link", "placement", "node walker", "data"), "the robot's diagnostics")
    world.until(lambda: complete(far, "link", "placement", "node walker", "data"), "the cloud's diagnostics")
    world.until(lambda: world.ear.diagnostics["placement"].values["site"] == "cloud", "the placement")
    own = version("robot-offload-agent")
    for side in ("release", "cloud_release"):
        world.until(lambda side=side: world.ear.diagnostics["placement"].values[side] == own, side)  # type: ignore[misc]
    link = world.ear.diagnostics["link"]
    assert link.values["endpoint"].startswith("quic/127.0.0.1:")
    assert 0 < float(link.values["round_trip_p50_ms"]) < 1000
    world.until(lambda: world.ear.diagnostics["node walker"].message == "inactive", "the robot's node stands by")
    world.until(lambda: far.diagnostics["node walker"].message == "active", "the cloud's node acts")
    world.until(lambda: int(world.ear.diagnostics["data"].values["command.cloud.passed"]) > 0, "commands pass")
    world.until(lambda: int(far.diagnostics["data"].values["command.sent"]) > 0, "commands are sent")


def test_diagnostics_carry_side_and_robot_in_standard_fields(world: World) -> None:
    heard = world.ear.hear(DiagnosticArray, "/diagnostics")
    world.until(lambda: heard, "diagnostics")
    status = heard[-1][1].status[0]
    assert status.name.startswith("robot_offload robot: ")
    assert status.hardware_id == "walker-1"
