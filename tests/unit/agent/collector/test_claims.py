"""One collector per public topic and domain on a host, whatever the identity of its agent."""

from __future__ import annotations

import os

import pytest

from robot_offload_agent.collector.claims import claim
from robot_offload_agent.errors import StartError

TOPIC = f"/a/topic/of/process/{os.getpid()}/{'long' * 30}"


def test_a_topic_has_one_collector_until_that_one_ends() -> None:
    held = claim(7, [TOPIC])
    with pytest.raises(StartError, match=f"{TOPIC} in domain 7 has another collector .*process {os.getpid()}"):
        claim(7, [TOPIC])
    for other in (*claim(8, [TOPIC]), *claim(7, [TOPIC + "/other"])):
        other.close()
    held[0].close()
    claim(7, [TOPIC])[0].close()
