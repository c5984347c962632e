"""Policies by name, and a user's own as `module:function`."""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload.errors import InputError
from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay.contract import PolicyMaker, SwitchingPolicy
from robot_offload_lab.replay.ours import Ours
from robot_offload_lab.replay.peers import Dwell, Mean, OneSide, Threshold


@dataclass(frozen=True)
class NamedPolicy:
    """A policy that can be chosen.

    Attributes:
        name: in options, tables and results.
        text: what it does, in a few words.
        make: makes a fresh one for a recording.
        foreign: whether it is a user's own: its errors are printed as lines, not as tracebacks of ours.
    """

    name: str
    text: str
    make: PolicyMaker
    foreign: bool = False


OURS: Final = NamedPolicy("ours", "the agents' own rule", Ours)
POLICIES: Final[Mapping[str, NamedPolicy]] = {
    policy.name: policy
    for policy in (
        OURS,
        NamedPolicy("thesis", "one message against one threshold", Threshold),
        NamedPolicy("dwell", "the same, 20 s between changes", Dwell),
        NamedPolicy("mean", "mean of 3 s, loss after 10 s", Mean),
        NamedPolicy("robot", "always the robot", lambda _: OneSide(Site.ROBOT)),
        NamedPolicy("cloud", "always the cloud, also over a dead link", lambda _: OneSide(Site.CLOUD)),
    )
}
CONSTANT: Final = ("robot", "cloud")
"""Reference policies that never decide."""


def find(name: str) -> NamedPolicy:
    """Return the policy called `name`, or of the function `module:function` (the current folder is searched as well).

    Raises:
        InputError: there is no such policy, or the module cannot be used.
    """
    if ":" in name:
        return NamedPolicy(name, "your own", _imported(name), foreign=True)
    if name not in POLICIES:
        close = difflib.get_close_matches(name, POLICIES, n=1)
        hint = f"did you mean {close[0]}?" if close else f"write one of {', '.join(POLICIES)}, or module:function"
        raise InputError(f"--policy: there is no policy {name!r}; {hint}")
    return POLICIES[name]


def _imported(name: str) -> PolicyMaker:
    module_name, _, function_name = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a foreign module may raise anything while it is imported
        raise InputError(f"--policy {name}: cannot import {module_name!r}: {_line(error)}") from error
    maker = getattr(module, function_name, None)
    if not callable(maker):
        raise InputError(f"--policy {name}: {module_name} has no function {function_name!r}")

    def make(settings: Settings) -> SwitchingPolicy:
        policy: SwitchingPolicy = maker(settings)
        for method in ("heard", "place"):
            if not callable(getattr(policy, method, None)):
                raise InputError(f"--policy {name}: what it makes has no method {method!r}")
        return policy

    return make


def _line(error: Exception) -> str:
    text = str(error).splitlines()
    return f"{type(error).__name__}: {text[0]}" if text else type(error).__name__
