"""What the operator and the agents tell each other: the state file, settings that change at run time, handing over."""

import datetime
import itertools
import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from cryptography import x509

from robot_offload.api.agent_state import parse_state
from robot_offload.decide import renewal
from robot_offload.render.pki import build_certificates
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.record import audit
from tests.ros.agent.conftest import ROS_LINK_DOMAIN
from tests.ros.agent.harness import AUTHOR, Plan, World
from tests.ros.agent.passage import holes
from tests.ros.agent.shared import Shared, judged

ACCEPTED = (True, "Accepted")
GENERATIONS = itertools.count(2)


@pytest.fixture(scope="module")
def own() -> Iterator[Shared]:
    """A world of this module's own: the cloud's agent has the operator's files."""
    bundled = {"generation": 1}
    shared = Shared(Plan(domains=(79, 80), files=True, robot=bundled, cloud=bundled))
    yield shared
    shared.close()


@pytest.fixture
def world(own: Shared) -> Iterator[World]:
    """Both agents over Zenoh, the cloud in charge; the robot has accepted settings that change nothing."""
    for world in judged(own):
        accept(world)
        world.goes_to("cloud")
        yield world


def accept(world: World, **different: Any) -> int:
    """Offers settings and waits until the robot runs them."""
    generation = offer(world, **different)
    world.until(lambda: world.state["settings"]["robot_generation"] == generation, "the robot runs them")
    assert answer(world) == ACCEPTED
    return generation


def offer(world: World, **different: Any) -> int:
    """Offers settings of a new generation, which is returned."""
    generation = next(GENERATIONS)
    world.offer(generation, **different)
    return generation


def answer(world: World) -> tuple[bool | None, str]:
    """What the robot says of the settings offered."""
    settings = world.state["settings"]
    return settings["accepted"], settings["reason"]


def generation(world: World) -> str:
    """That the robot says it runs."""
    return str(world.ear.diagnostics["placement"].values["generation"])


def told(world: World, key: str) -> str:
    """A problem in the robot's diagnostics, "" while it has none of that name."""
    return str(world.ear.diagnostics["data"].values.get(key, ""))


def test_the_state_file_follows_every_change(world: World) -> None:
    world.until(lambda: world.state["site"] == "cloud" and world.state["ready"], "the cloud acts")
    world.until(lambda: world.state["round_trip_ms"]["p99"] is not None, "round trips")
    state = world.state
    assert (state["version"], state["agent_generation"], state["connected"]) == (1, 1, True)
    assert 0 < state["round_trip_ms"]["p50"] <= state["round_trip_ms"]["p99"] < 1000
    world.until(lambda: world.state["nodes"] == [{"name": "walker", "state": "active"}], "the cloud's node acts")
    world.override("Robot")
    world.until(lambda: (world.state["site"], world.state["reason"]) == ("robot", "PinnedToRobot"), "the robot acts")
    assert world.state["epoch"] >= state["epoch"]
    assert world.state["since"] == state["since"]
    world.kill_agent("robot")
    world.until(lambda: not world.state["connected"], "the robot is gone")
    gone = world.state
    assert (gone["site"], gone["reason"]) == ("unknown", "RobotNotConnected")
    assert gone["since"] > state["since"]
    world.until(lambda: world.state["written"] > gone["written"], "it is written again while nothing happens")


def test_the_robots_own_numbers_reach_the_state_file_and_go_with_the_robot(world: World) -> None:
    world.until(lambda: sum(said(world, "robot").latency.counts) > 50, "round trips")
    world.until(lambda: sum(said(world, "robot").gaps[0][1].counts) > 10, "commands pass")
    both = {"control", "pulse", "data"}
    world.until(lambda: both | {"collector"} <= dict(said(world, "robot").processes).keys(), "the robot's processes")
    world.until(lambda: both <= dict(said(world, "cloud").processes).keys(), "the cloud's processes")
    robot, cloud = said(world, "robot"), said(world, "cloud")
    assert (robot.garbage, cloud.garbage, cloud.garbage_reports) == (0, 0, 0)
    world.until(lambda: any(report(world).get("ages", {}).values()), "how old the cloud's commands are")
    before = sum(count for *_, count in robot.changeovers)
    world.override("Robot")
    world.until(lambda: sum(count for *_, count in said(world, "robot").changeovers) > before, "the change is counted")
    pinned = ("robot", "PinnedToRobot")
    world.until(lambda: pinned in {one[:2] for one in said(world, "robot").changeovers}, "by its reason")
    world.until(lambda: silence_ms(world, *pinned) > 0, "the silence around it")
    world.kill_agent("robot")
    world.until(lambda: world.state["robot"] is None, "nobody vouches for old numbers")
    assert said(world, "cloud").processes


def report(world: World) -> dict[str, Any]:
    """The robot's report as it stands in the state file; empty while none has come for some seconds."""
    return world.state["robot"] or {}


def silence_ms(world: World, to: str, reason: str) -> float:
    """The silence of the last changeover, if it was this one and the silence is known; 0 otherwise."""
    last = report(world).get("changeover") or {}
    return (last.get("gap_ms") or 0.0) if (last.get("to"), last.get("reason")) == (to, reason) else 0.0


def audited(world: World, kind: str, **what: str) -> bool:
    """Whether the robot's audit trail has an entry of this kind with these words, by the cloud's agent."""
    entries = [one for one in audit.exported(world.audit_trail()) if one["kind"] == kind]
    return any(what.items() <= one["what"].items() and "offered by the cloud's agent" in one["who"] for one in entries)


def said(world: World, side: str) -> Any:
    """The numbers of a side as the reporter reads them; raises KeyError while there are none, as `until` likes it."""
    text = json.dumps(world.state)
    found = getattr(parse_state(text), side)
    if found is None or (side == "robot" and not (found.latency and found.gaps)):
        raise KeyError(side)
    return found


def test_a_new_pin_reaches_the_robot_and_survives_its_restart_with_the_cloud_away(world: World) -> None:
    pinned = accept(world, pin="Robot")
    world.until(lambda: world.reason == "PinnedToRobot" and world.site == "robot", "the pin is obeyed")
    world.until(lambda: world.ear.get_parameter("/cloud_switcher", "pin") == "Robot", "the parameter shows it")
    world.until(
        lambda: audited(world, "Settings", generation=str(pinned), answer="Accepted", changed_by=AUTHOR), "the push"
    )
    world.until(lambda: audited(world, "Pin", generation=str(pinned), to="Robot", changed_by=AUTHOR), "and its pin")
    assert audit.verify(world.audit_trail()).problems == ()
    by_hand = world.ear.set_parameter("/cloud_switcher", "pin", "Cloud")
    assert "comes from the resource" in by_hand.reason
    world.kill_agent("cloud")
    world.kill_agent("robot")
    world.start_agent("robot")
    world.until(lambda: world.site and world.reason == "PinnedToRobot", "the pin is obeyed without a cloud")
    world.until(lambda: generation(world) == str(pinned), "it says which generation it runs")
    world.until(lambda: world.ear.get_parameter("/cloud_switcher", "pin") == "Robot", "the parameter shows it")
    world.start_agent("cloud")
    world.until(lambda: world.state["connected"] and answer(world) == ACCEPTED, "a new cloud hears the same")
    offer(world, pin="Auto")
    world.goes_to("cloud")


def test_settings_that_cannot_be_are_refused_and_told_and_the_robot_keeps_what_it_runs(world: World) -> None:
    pinned = accept(world, pin="Robot")
    world.until(lambda: world.reason == "PinnedToRobot", "the pin is obeyed")
    offer(world, pin="Moon", lease_ms="long")
    world.until(lambda: answer(world) == (False, "Invalid"), "they are refused")
    settings = world.state["settings"]
    assert settings["robot_generation"] == pinned
    assert "parameter pin: " in settings["message"]
    assert "parameter lease_ms: " in settings["message"]
    world.until(lambda: "Moon" in told(world, "SettingsRefused"), "the robot tells it")
    assert world.reason == "PinnedToRobot"
    offer(world, pin="Auto")
    world.until(lambda: answer(world) == ACCEPTED, "better ones are accepted")
    world.until(lambda: not told(world, "SettingsRefused"), "nothing is wrong any more")
    world.goes_to("cloud")


@pytest.mark.parametrize(
    ("offered", "reason"),
    [
        ({"lease_ms": 5000.0}, "HardLimit"),
        ({"input__odom__max_age_ms": 500.0}, "HardLimit"),
        ({"heartbeat_period_ms": 40.0}, "NeedsBundle"),
    ],
    ids=["lease", "input", "beats"],
)
def test_no_settings_loosen_the_limits_in_the_robots_file_or_change_what_needs_a_bundle(
    world: World, offered: dict[str, float], reason: str
) -> None:
    before = world.state["settings"]["robot_generation"]
    offer(world, **offered)
    world.until(lambda: answer(world) == (False, reason), "they are refused")
    assert world.state["settings"]["robot_generation"] == before
    assert next(iter(offered)).replace("__", ".") in world.state["settings"]["message"]
    world.passes("cloud", 10)


def test_stricter_limits_hold_while_the_cloud_acts_and_cost_no_command(world: World) -> None:
    since = len(world.arrivals)
    accept(world, lease_ms=300.0, loss_timeout_ms=120.0, max_command_age_ms=200.0, input__odom__max_rate_hz=5.0)
    world.until(lambda: told(world, "odom.rate_limited"), "the input is sent less often")
    world.place("robot")
    world.goes_to("cloud")
    assert holes(world.arrivals[since:]) == 0


def test_a_damaged_settings_file_in_the_cloud_is_told_and_offers_nothing(world: World) -> None:
    (world.folder / "settings.file").write_text("{ no yaml")
    world.until(lambda: answer(world) == (None, "SettingsUnreadable"), "it is told")
    world.passes("cloud", 10)


def test_damaged_kept_settings_are_told_and_keep_no_robot_from_starting(build: Callable[..., World]) -> None:
    world = build()
    state = world.folder / "state"
    state.mkdir()
    (state / "settings.json").write_text('{"version": 1, "uid": ')
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot")
    world.until(lambda: "settings.json is damaged" in told(world, "KeptSettingsDamaged"), "it is told")


def test_handing_over_lets_the_robot_act_before_it_is_answered_and_the_next_cloud_is_used_at_once(world: World) -> None:
    since = len(world.arrivals)
    name = world.hand_over()
    world.until(lambda: world.state["handover"] == name, "it is answered")
    answered_s = now_s()
    assert world.state["site"] == "robot"
    world.until(lambda: world.site == "robot", "the robot says so")
    assert world.reason == "PodStopping"
    moved = next(p for p in world.placed[::-1] if p.phase == "ToRobot")
    assert moved.t_s < answered_s
    world.until(lambda: world.arrivals[-1].t_s > answered_s + 2.0, "time passes")
    assert {a.site for a in world.arrivals[since:] if a.t_s > answered_s} == {"robot"}
    assert holes(world.arrivals[since:]) == 0
    world.kill_agent("cloud")
    world.new_pod()
    world.goes_to("cloud")


def test_with_no_robot_connected_handing_over_is_answered_at_once(build: Callable[..., World]) -> None:
    world = build(files=True)
    world.start_agent("cloud")
    world.until(lambda: world.state["ready"], "the cloud's agent is ready")
    name = world.hand_over()
    world.until(lambda: world.state["handover"] == name, "it is answered")
    assert world.state["connected"] is False


def test_a_robot_that_drives_gets_a_certificate_for_its_own_key_and_dials_with_it(build: Callable[..., World]) -> None:
    world, now = build(files=True), datetime.datetime.now(datetime.timezone.utc)
    made = build_certificates(robot="walker-1", host_names=["127.0.0.1"], now=now)
    world.write_bundle(made)
    world.start()
    since = len(world.arrivals)
    world.until(lambda: world.state["certificate"]["request"], "the robot asks")
    bundled = int(world.state["certificate"]["serial"], 16)
    signer = renewal.Signer(made.client_ca, "walker-1", 30, bundled, None, {})
    signed = renewal.answer(world.state["certificate"]["request"], signer, now)
    assert signed.reason == renewal.ISSUED, signed.message
    world.answer(signed.text())
    serial = f"{x509.load_pem_x509_certificate(signed.certificate.encode()).serial_number:x}"
    world.until(lambda: world.state["certificate"]["serial"] == serial, "the robot has taken it")
    world.until(lambda: not world.state["certificate"]["request"], "it asks no more")
    world.passes("cloud", 10)
    assert holes(world.arrivals[since:]) == 0
    # An older bundle whose authority the cloud does not know: the robot gets in with its own key alone.
    world.kill_agent("robot")
    earlier = build_certificates(robot="walker-1", host_names=["127.0.0.1"], now=now - datetime.timedelta(days=1))
    assert world.certificates is not None
    world.certificates.robot.certificate.write_bytes(earlier.robot.certificate)
    world.certificates.robot.private_key.write_bytes(earlier.robot.private_key)
    world.start_agent("robot")
    world.goes_to("cloud")
    world.until(lambda: world.state["certificate"]["serial"] == serial, "it says which one it dials with")


def test_over_dds_too_settings_reach_the_robot_and_the_cloud_hands_over(build: Callable[..., World]) -> None:
    world = build(domains=(ROS_LINK_DOMAIN, ROS_LINK_DOMAIN), link="ros", files=True).start()
    accept(world, min_dwell_ms=10.0)
    name = world.hand_over()
    world.until(lambda: world.state["handover"] == name, "the robot has taken over")
    world.goes_to("robot")
