"""How long a message was on its way to its consumer."""

from __future__ import annotations

from robot_offload_lab.judge.recording import Arrival


def travel_ms(arrival: Arrival) -> float:
    """Return the time from the stamp, just before it was published, until the consumer's middleware had it.

    Not the age that decides whether a command is stale: that one ends where the collector passes the message on, and
    leaves out the last hop.
    """
    return (arrival.t_s - arrival.sent_t_s) * 1e3
