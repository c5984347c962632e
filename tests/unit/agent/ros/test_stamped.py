"""The publisher's stamp beside each message, and middlewares that have none."""

from robot_offload_agent.ros.raw import stamped


def test_a_message_comes_with_its_publishers_stamp_or_without_one() -> None:
    heard: list[tuple[bytes, float | None]] = []
    hear = stamped(lambda payload, published_s: heard.append((payload, published_s)))
    hear(b"one", {"source_timestamp": 1_700_000_000_500_000_000, "received_timestamp": 0})
    hear(b"two", {"source_timestamp": 0, "received_timestamp": 0})
    assert heard == [(b"one", 1_700_000_000.5), (b"two", None)]
