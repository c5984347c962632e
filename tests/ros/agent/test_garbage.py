"""Nothing from outside ends a process: garbage at every door of both agents while they run and one of them acts.

What is thrown is made from good messages (shortened, with other values, other types, other versions) and from nothing.
"""

import json
import random
import socket
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import pytest
import yaml

from robot_offload_agent.relay.journal import Journal
from robot_offload_agent.runtime.bus import KINDS
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.data import probe
from robot_offload_core.fence import envelope
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals import journal, words
from robot_offload_core.topics.snapshots import FORMAT, HEADER, MAGIC
from robot_offload_core.words import beats
from tests.ros.agent.ears import wait_until
from tests.ros.agent.harness import PROCESSES, World
from tests.ros.agent.passage import UNDISTURBED_S, longest_gap_s
from tests.ros.agent.test_identity import a_beat, voice
from tests.ros.agent.test_state import DECLARED
from tests.ros.ports import is_free
from tests.unit.core.relay.goals.garbled import letters, spoiled

WORDS: list[object] = [
    None, True, -1, 2**63, 1e308, float("nan"), "", "x" * 5000, "edge:1", "\0", "[", [], {}, [[]], {"a": {"b": []}},
]  # fmt: skip
CALLED = ("/count", "/many", "/ask", "/do", "count", "ask")
NAMES = ("", "odom", "map", "command", "walker", "../../x", "os", "x" * 300)
EACH = 60
"""Messages for each door."""
SEED = 20260117


def probes(incarnation: str, chance: random.Random) -> Iterator[bytes]:
    """Probes of a known sender, each with one field that is of another kind, and some of other versions."""
    good: dict[str, object] = {
        "v": probe.VERSION, "i": incarnation, "d": "", "h": "", "l": {}, "t": {}, "n": {}, "w": "", "s": "",
    }  # fmt: skip
    for field in good:
        for word in WORDS:
            yield json.dumps({**good, field: word}).encode()
    for field in ("l", "t", "n"):
        for name in NAMES:
            yield json.dumps(
                {**good, field: {name: chance.choice(["", "os/msg/path", "x" * 300, "std_msgs/msg/No"])}}
            ).encode()
    for notes in WORDS:
        text = json.dumps({"leaving": notes, "offer": [notes, {"pin": notes, "lease_ms": notes, "x": [notes]}]})
        yield json.dumps({**good, "s": text}).encode()
        yield json.dumps({**good, "s": json.dumps({"generation": notes, "reason": notes, "site": notes})}).encode()
        stated = {"leaving": "", "vetoes": [[notes, notes]], "parameters": {"walker": [notes, "", {"rate_hz": notes}]}}
        yield json.dumps({**good, "s": json.dumps(stated)}).encode()
    yield b"[" * 100_000
    for _ in range(EACH):
        yield spoiled(json.dumps(good).encode(), chance)


def envelopes(incarnations: tuple[str, str], chance: random.Random) -> Iterator[bytes]:
    """Headers of known and unknown senders, good and spoiled."""
    for _ in range(EACH):
        token = Token(incarnations[0], chance.choice([0, 1, 2**64 - 1]), incarnations[1])
        header = envelope.encode(envelope.Envelope(token, chance.choice([0, 2**64 - 1]), chance.choice([0, 1, 2**63])))
        yield header if chance.random() < 0.5 else spoiled(header, chance)


@pytest.fixture
def steady(world: World) -> Iterator[World]:
    """The cloud acts; afterwards every process is the one that it was, and every message came in time."""
    pids = {(side, name): world.pid(side, name) for side, names in PROCESSES.items() for name in names}
    at_s = now_s()
    yield world
    world.passes("cloud", 20)
    assert {each: world.pid(*each) for each in pids} == pids
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S


def counter(world: World, side: str, status: str, name: str) -> int:
    ear = world.ear if side == "robot" else world.cloud_ear()
    found = ear.diagnostics.get(status)
    return int(found.values.get(name, "0")) if found else 0


def test_a_hostile_robot_ends_no_process_of_the_cloud(steady: World) -> None:
    chance = random.Random(SEED)
    robot = steady.placed[-1].control
    with voice(steady) as say:
        good = beats.encode(a_beat(steady.folder.name)).encode()
        for _ in range(EACH):
            say("beat", spoiled(good, chance))
    with voice(steady, "data") as say:
        for payload in probes(robot, chance):
            say("probe", payload)
            say("report", payload)
        for header in envelopes((robot, ""), chance):
            for channel in ("in/odom", "in/map", "in/unknown", "mirror/command", "mirror/unknown", "out/command"):
                say(channel, chance.randbytes(chance.randrange(50)), header)
    steady.until(lambda: counter(steady, "cloud", "data", "garbage.probe"), "garbage is counted")


def test_a_hostile_cloud_ends_no_process_of_the_robot_which_goes_on(build: Callable[..., World]) -> None:
    world, chance = build(), random.Random(SEED)
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot", 40)
    pids = {name: world.pid("robot", name) for name in PROCESSES["robot"]}
    with voice(world, "pulse", "cloud") as beat, voice(world, "data", "cloud") as say:

        def connected() -> bool:
            say("probe", b"x")
            return bool(counter(world, "robot", "data", "garbage.probe"))

        world.until(connected, "garbage is heard and counted")
        good = beats.encode(replace(a_beat(world.folder.name), sender=Site.CLOUD, body=beats.CloudReport())).encode()
        for _ in range(EACH):
            beat("beat", spoiled(good, chance))
        for payload in probes("cd" * 16, chance):
            say("probe", payload)
        for header in envelopes((world.placed[-1].control, "cd" * 16), chance):
            say("out/command", chance.randbytes(chance.randrange(50)), header)
            say("out/unknown", b"", header)
        at_s = now_s()
        world.passes("robot", 40)
    assert {name: world.pid("robot", name) for name in pids} == pids
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    world.check()


@pytest.mark.parametrize("side", PROCESSES)
def test_garbage_at_the_sockets_of_the_processes_ends_none(steady: World, side: str) -> None:
    chance = random.Random(SEED)
    folder = steady.folder / side
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as somebody:
        for process in (*PROCESSES[side], "supervisor"):
            for payload in bus_garbage(chance):
                somebody.sendto(payload, str(folder / f"{process}.sock"))
    steady.until(lambda: counter(steady, side, "data", "garbage.control"), "garbage is counted")


def bus_garbage(chance: random.Random) -> Iterator[bytes]:
    for kind in KINDS:
        for word in WORDS:
            yield b"m" + json.dumps([kind, word]).encode()
            yield b"m" + json.dumps([kind, [word, word]]).encode()
    for _ in range(EACH):
        yield spoiled(b'm["Heard",["ab",1,2.0]]', chance)
        yield chance.choice([b"e", b"p", b"o", b"l", b"E", b"P", b"O", b"L"]) + chance.randbytes(chance.randrange(100))
    yield b"m" + b"[" * 100_000


def files(chance: random.Random) -> Iterator[str]:
    """Settings files that are none."""
    good = yaml.safe_dump({"/**": {"ros__parameters": {"generation": 1, "pin": "Auto"}}})
    for word in WORDS:
        yield json.dumps({"/**": {"ros__parameters": {"generation": word}}})
        yield json.dumps({"/**": {"ros__parameters": {"pin": word, "input": word}}})
    yield "a: &a [x]\nb: &b [*a, *a]\n" + "".join(f"c{n}: &c{n} [*b, *b]\n" for n in range(9))
    yield "/**:\n  ros__parameters:\n    generation: 2026-99-99\n"
    yield "[" * 5000
    for _ in range(10):
        yield spoiled(good.encode(), chance).decode("latin-1")


def test_garbage_in_the_files_of_the_cluster_ends_no_process(build: Callable[..., World]) -> None:
    world = build(files=True)
    world.start_agent("cloud")
    world.until(lambda: world.state["ready"] is not None, "the state file")
    pids = {name: world.pid("cloud", name) for name in PROCESSES["cloud"]}
    for text in files(random.Random(SEED)):
        (world.folder / "settings.file").write_text(text)
        (world.folder / "handover.file").write_text(text)
        wait_until(lambda: False, 0.15)
    world.offer(3)
    world.until(
        lambda: "generation 3" in world.state["settings"]["message"].lower(), "good settings are read afterwards"
    )
    assert {name: world.pid("cloud", name) for name in pids} == pids


def snapshots(chance: random.Random) -> Iterator[bytes]:
    """Messages for a node's state: whole ones, too large ones, torn ones, of other formats."""
    for size in (0, 3, 1000, 5000):
        data = chance.randbytes(size)
        body = HEADER.pack(MAGIC, chance.choice([FORMAT, 9]), 1, size, zlib.crc32(data)) + data
        good = b"\0\1\0\0" + bytes(8) + len(body).to_bytes(4, "little") + body
        yield good
        for _ in range(10):
            yield spoiled(good, chance)


def throw(say: Callable[..., None], writer: str, reader: str, incarnations: tuple[str, str], agent: str) -> None:
    """Letters, snapshots and large messages, from a side whose incarnation is `agent`."""
    chance = random.Random(SEED)
    for frame in letters(writer, reader, agent, CALLED, chance):
        say("relay", frame)
    heads = list(envelopes(incarnations, chance))
    for payload in snapshots(chance):
        say("state/walker_1", payload, chance.choice(heads))
        say("state/unknown", payload, chance.choice(heads))
    for channel in ("in/odom", "in/map", "out/command", "mirror/command", "relay", "state/walker_1", "probe", "report"):
        say(channel, chance.randbytes(300_000), chance.choice(heads))


def test_garbage_for_relays_states_and_large_messages_ends_no_process_of_either_side(
    build: Callable[..., World],
) -> None:
    world = build(serves=True, both=DECLARED)
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot", 40)
    world.until(lambda: world.placed, "the robot's placement")
    robot, cloud, heard = world.placed[-1].control, "cd" * 16, list[str]()

    def note(frame: bytes) -> None:
        with suppress(words.WordError):
            heard.append(words.decode(frame).writer)

    pids = {name: world.pid("robot", name) for name in (*PROCESSES["robot"], "relay")}
    with voice(world, "pulse", "cloud") as beat, voice(world, "data", "cloud", hears=note) as say:
        good = replace(a_beat(world.folder.name), sender=Site.CLOUD, incarnation=cloud, body=beats.CloudReport())
        beat("beat", beats.encode(good).encode())
        world.until(lambda: heard, "the robot's relay is heard")
        throw(say, "ef" * 16, heard[-1], (robot, cloud), cloud)
        world.until(lambda: counter(world, "robot", "data", "garbage"), "the robot's relay counts it")
    folder = world.folder / "robot"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as somebody:
        for payload in bus_garbage(random.Random(SEED)):
            somebody.sendto(payload, str(folder / "relay.sock"))
    world.until(lambda: counter(world, "robot", "data", "garbage.relay"), "garbage on the bus is counted")
    assert {name: world.pid("robot", name) for name in pids} == pids

    # QUIC keeps a closed listener's port for a while, up to half a minute, until its connections are given up.
    ours = [world.ports[session] for session in ("pulse", "data")]
    world.until(
        lambda: all(is_free(port, socket.SOCK_DGRAM) for port in ours),
        "the ports of the cloud that the test played are free",
        60.0,
    )

    kept = Journal(folder)
    chance, called = random.Random(SEED), journal.call_opened(b"caller", "/ask")
    for record in [*kept.load(), *(spoiled(called, chance) or b"x" for _ in range(EACH)), b"x", bytes(200)]:
        kept.append(record)
    world.kill("robot", "relay")
    heard.clear()
    world.start_agent("cloud")
    world.start_node("cloud")
    world.place("cloud", stay=True)  # these replicas publish no state, for which the policy would wait
    all_pids = {(side, name): world.pid(side, name) for side in PROCESSES for name in (*PROCESSES[side], "relay")}
    with voice(world, "data", hears=note) as say:
        world.until(lambda: heard, "the cloud's relay is heard")
        throw(say, "fe" * 16, heard[-1], (robot, ""), robot)
    with voice(world, "data", large=True) as say:
        throw(say, "fe" * 16, heard[-1], (robot, ""), robot)
    world.until(lambda: counter(world, "cloud", "data", "garbage"), "the cloud's relay counts it")
    before = len(world.arrivals)  # of either side: this robot's own relay is not heard again after a thief's
    world.until(lambda: len(world.arrivals) > before + 40, "messages pass")
    assert {each: world.pid(*each) for each in all_pids} == all_pids, world.processes.logs()
    world.check()
