"""The words of the fence for who may act, where everything else takes them from."""

from __future__ import annotations

from robot_offload_core.fence.token import INCARNATION_LENGTH, Site, Token, is_incarnation, presence

__all__ = ["INCARNATION_LENGTH", "Site", "Token", "is_incarnation", "presence"]
