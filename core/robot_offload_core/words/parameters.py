"""Bounds and names for the parameters that follow a node."""

from __future__ import annotations

MAX_NAME = 256
"""Characters of the name of a node or a parameter."""


MAX_SHOWN = 8
"""Most parameters of one node that a message names."""


PRIVATE_TOPICS = "/offload/{}/"
