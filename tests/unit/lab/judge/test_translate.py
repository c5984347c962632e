"""From what a consumer hears to the records of a run."""

import json

from robot_offload_lab.judge import translate
from robot_offload_lab.judge.recording import Inhibit, Obstacle, PathPoint
from robot_offload_lab.judge.streams import examine
from robot_offload_lab.wire.options import LinkOptions

STATE = {
    "x": 2.5,
    "y": -0.1,
    "speed": 0.6,
    "collisions": 0,
    "stops": 1,
    "inhibited": False,
    "goal_reached": False,
    "goal": [44.5, 0.0],
    "corridor": {"length": 46.0, "width": 2.4},
    "obstacles": [[5.0, 0.3, 0.2]],
}


def state(**changes: object) -> str:
    return json.dumps({**STATE, **changes})


def test_a_stamped_message_tells_its_producer_sequence_and_side() -> None:
    arrival = translate.Arrivals("/cmd_vel").stamped(10.0, "remote_controller#17", 9.99)
    assert (arrival.producer, arrival.sequence, arrival.site) == ("remote_controller", 17, "cloud")
    assert (arrival.t_s, arrival.sent_t_s) == (10.0, 9.99)


def test_a_text_tells_its_producer_sequence_and_side() -> None:
    arrival = translate.Arrivals("/chatter").text(10.0, "hello 4 from talker")
    assert (arrival.producer, arrival.sequence, arrival.site) == ("talker", 4, "robot")


def test_a_message_without_identity_counts_for_the_side_in_charge() -> None:
    arrivals = translate.Arrivals("/map", acting="cloud")
    first, second = arrivals.stamped(1.0, "odom", 0.9), arrivals.other(2.0)
    assert (first.site, second.site) == ("cloud", "cloud")
    assert (first.sequence, second.sequence) == (1, 2)
    assert not first.named
    assert not second.named


def test_a_text_that_comes_twice_is_a_duplicate() -> None:
    arrivals = translate.Arrivals("/chatter")
    heard = [arrivals.text(t / 10, f"hello {n} from talker") for t, n in enumerate((7, 8, 9, 8, 10))]
    stream = examine("/chatter", heard, 1.0, 1000.0)
    assert [arrival.sequence for arrival in stream.duplicates] == [8]
    assert not stream.reordered


def test_a_talker_that_counts_anew_is_no_duplicate() -> None:
    arrivals = translate.Arrivals("/chatter")
    heard = [arrivals.text(t / 10, f"hello {n} from talker") for t, n in enumerate((97, 98, 2, 3, 4))]
    stream = examine("/chatter", heard, 1.0, 1000.0)
    assert not stream.duplicates
    assert not stream.reordered


def test_a_placement_tells_the_silence_at_a_sudden_loss() -> None:
    said = {"site": "robot", "epoch": 3, "reason": "HeartbeatLost", "message": "Gone", "silent_ms": 92.5}
    change = translate.placement(5.0, json.dumps(said))
    assert change is not None
    assert (change.site, change.epoch, change.detect_ms) == ("robot", 3, 92.5)


def test_garbage_is_no_placement_and_no_world() -> None:
    for text in ("", "{", "[]", "null", "3", '{"site": "moon", "silent_ms": null}', '{"corridor": 1}'):
        assert translate.placement(0.0, text) is None
        assert translate.drive(0.0, text) is None


def test_the_world_gives_a_path_point_and_each_obstacle_once() -> None:
    first = translate.drive(1.0, state())
    second = translate.drive(1.1, state(x=2.6, obstacles=[[5.0, 0.3, 0.2], [9.0, -0.5, 0.25]]))
    assert first is not None
    assert second is not None
    assert list(first.records(None)) == [PathPoint(1.0, 2.5, -0.1, 0.6), Obstacle(5.0, 0.3, 0.2)]
    assert list(second.records(first)) == [PathPoint(1.1, 2.6, -0.1, 0.6), Obstacle(9.0, -0.5, 0.25)]


def test_the_world_tells_when_the_driver_is_inhibited_and_released() -> None:
    free, held = translate.drive(1.0, state()), translate.drive(1.1, state(inhibited=True))
    assert free is not None
    assert held is not None
    assert Inhibit(1.1, inhibited=True) in held.records(free)
    assert Inhibit(1.0, inhibited=False) in free.records(held)
    assert Inhibit(1.1, inhibited=True) in held.records(None)
    assert not any(isinstance(record, Inhibit) for record in free.records(None))


def test_the_link_is_sampled_closely_and_at_each_edge_of_an_outage() -> None:
    schedule = LinkOptions(delay="10ms", outages=("0.33/1",)).schedule()
    samples = list(translate.link_samples(schedule, 100.0, 100.0, 102.0))
    times = [sample.t_s for sample in samples]
    assert times == sorted(times)
    cut = [sample.t_s for sample in samples if sample.rtt_ms is None]
    assert abs(min(cut) - 100.67) < 0.001
    assert abs(max(cut) - 101.95) < 0.001
    assert {sample.rtt_ms for sample in samples} == {20.0, None}


def test_samples_taken_in_pieces_are_the_same_as_at_once() -> None:
    schedule = LinkOptions(delay="10ms", outages=("0.33/1",), slow=("0.4/1.7@80ms",)).schedule()
    at_once = list(translate.link_samples(schedule, 7.0, 7.0, 17.0))
    pieces: list[object] = []
    edges = [7.0 + 0.023 * n for n in range(434)]
    for from_s, to_s in zip(edges, [*edges[1:], 17.0], strict=True):
        pieces += translate.link_samples(schedule, 7.0, from_s, to_s)
    assert pieces == at_once


def test_a_message_that_was_sent_again_holds_up_the_ones_behind_it_and_is_not_reordered() -> None:
    arrivals = translate.Arrivals("/cmd_vel")
    received_s = {627: 1.00, 628: 1.028, 629: 1.020, 630: 1.040}  # in the order of delivery; 628 came a second time
    heard = [
        arrivals.stamped(arrivals.delivered_s(t_s), f"remote_controller#{number}", 0.99, 1.0)
        for number, t_s in received_s.items()
    ]
    assert [each.t_s for each in heard] == [1.00, 1.028, 1.028, 1.040]
    assert not examine("/cmd_vel", sorted(heard, key=lambda each: each.t_s), 2.0, 150.0).reordered
