"""Makes a test of a part of a black box: the decisions that were written are what it expects."""

from __future__ import annotations

import json
from collections.abc import Sequence

TEMPLATE = '''"""{title}

A part of a black box: {steps} steps of {machines}. The test fails when the core decides otherwise than it did
on the robot. Where it did wrong, change the expected decisions in BOX ("did" lines) to what it should have done, or
replace the last assertion by one about the states that `Replayed` gives.
"""

from robot_offload_core import blackbox
from robot_offload_core.blackbox import Differs, Replayed

BOX = {box}


def test_{name}() -> None:
    found = list(blackbox.replay(BOX))
    assert sum(isinstance(one, Replayed) for one in found) == {steps}
    assert [one for one in found if isinstance(one, Differs)] == []
'''


def test_text(name: str, title: str, lines: Sequence[str], steps: int, machines: Sequence[str]) -> str:
    """Returns a test module that replays `lines`; `name` is an identifier."""
    box = "[\n" + "".join(f"    {json.dumps(line)},  # noqa: E501\n" for line in lines) + "]"
    return TEMPLATE.format(title=title, steps=steps, machines=" and ".join(machines), box=box, name=name)
