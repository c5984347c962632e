"""The small messages of an action as serialized bytes, so that no goal, result or feedback has to be decoded.

Plain CDR in the byte order of this machine, as rmw gives and takes it: 4 bytes of encapsulation, then the fields, each
aligned to its size. The tests compare every one with rclpy's output.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Sequence

from robot_offload_core.relay.goals.ports import CancelCode, GoalEntry, GoalStatus

_LITTLE = sys.byteorder == "little"
_ENCAPSULATION = b"\x00\x01\x00\x00" if _LITTLE else b"\x00\x00\x00\x00"
_ORDER = "<" if _LITTLE else ">"
_ACCEPTED = struct.Struct(f"{_ORDER}?3xiI")
_TIME = struct.Struct(f"{_ORDER}iI")
_CANCELLED = struct.Struct(f"{_ORDER}b3xI")
_STATUS_AT = 4
_SECOND_NS = 1_000_000_000


def goal_response(accepted: bool, stamp_ns: int) -> bytes:
    """Return the response to a `send_goal`."""
    return _ENCAPSULATION + _ACCEPTED.pack(accepted, *divmod(stamp_ns, _SECOND_NS))


def is_accepted(response: bytes) -> bool:
    """Return whether a response to a `send_goal` accepts the goal."""
    return response[_STATUS_AT : _STATUS_AT + 1] == b"\x01"


def result_request(goal_id: bytes) -> bytes:
    """Return a request for a goal's result."""
    return _ENCAPSULATION + goal_id


def result_status(response: bytes) -> GoalStatus:
    """Return the status in a response to a `get_result`; raise ValueError if it is not valid."""
    return GoalStatus(response[_STATUS_AT]) if len(response) > _STATUS_AT else GoalStatus.UNKNOWN


def with_status(response: bytes, status: GoalStatus) -> bytes:
    """Return a response to a `get_result` with another status."""
    return response[:_STATUS_AT] + bytes([status]) + response[_STATUS_AT + 1 :]


def cancel_request(goal_id: bytes) -> bytes:
    """Return a request to cancel one goal."""
    return _ENCAPSULATION + goal_id + _TIME.pack(0, 0)


def read_cancel_request(request: bytes) -> tuple[bytes, int]:
    """Return the goal id and the stamp, ns, of a request to cancel."""
    second, nanosecond = _TIME.unpack_from(request, 20)
    return request[4:20], second * _SECOND_NS + nanosecond


def cancel_response(code: CancelCode, goals: Sequence[GoalEntry]) -> bytes:
    """Return the response to a request to cancel: the goals that are being cancelled."""
    entries = (goal.goal_id + _TIME.pack(*divmod(goal.stamp_ns, _SECOND_NS)) for goal in goals)
    return _ENCAPSULATION + _CANCELLED.pack(code, len(goals)) + b"".join(entries)


def cancel_code(response: bytes) -> CancelCode:
    """Return the code of a response to a request to cancel; an unknown one is REJECTED."""
    code = response[_STATUS_AT] if len(response) > _STATUS_AT else CancelCode.REJECTED
    return CancelCode(code) if code in list(CancelCode) else CancelCode.REJECTED


def status_array(goals: Sequence[GoalEntry]) -> bytes:
    """Return a GoalStatusArray."""
    body = bytearray(struct.pack(f"{_ORDER}I", len(goals)))
    for goal in goals:
        body += goal.goal_id
        body += bytes(-len(body) % 4) + _TIME.pack(*divmod(goal.stamp_ns, _SECOND_NS)) + bytes([goal.status])
    return _ENCAPSULATION + bytes(body)
