"""Topics that the group publishes and subscribes, and others publish too: /tf, /diagnostics, /joint_states.

A remapping moves a process's subscription together with its publisher. So the agent fills the private topic: with
everything that others publish on the public topic, and on the standby with the holder's part too. Messages that we
publish come back to our own subscription; they are recognised by their bytes, counted, and never collected or forwarded
again. Not safe for several threads by itself: the shell holds a lock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from typing import Any

from robot_offload_core.fence.token import Site
from robot_offload_core.topics import transforms
from robot_offload_core.topics.transforms import Transform, TransformsError
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.settings import OutputSpec

ECHO_S = 3.0
"""A message that has not come back by then was lost on the way."""
MAX_ECHOES = 4096
OWN_FRAME_S = 1.0
"""Longest age of a replica's newest transform at which it still publishes the frame itself."""
OWN_PERIODS = 2.0
OWN_JITTER_S = 0.05
"""A replica publishes a frame itself while its newest transform is no older than two of its periods plus a jitter, at
most a second. With one second for all, the private topic of a Warm side had a gap of that length after each change."""
FADING = 0.9
"""Factor on the longest time between two transforms at each further one, so that a burst does not count as a period."""


MAX_LATCHED_OF_OTHERS = 64
TAKEN_S = 10.0
"""How long a frame of the group published by another node stays a problem; static ones are published once."""


class Echoes:
    """Messages that we have published on a topic to which we subscribe, until they come back.

    A latched message comes back to each new subscription of ours.
    """

    def __init__(self, *, latched: bool = False) -> None:
        self.lasting: deque[Any] = deque(maxlen=MAX_LATCHED_OF_OTHERS if latched else 0)
        self.waiting: dict[Any, int] = {}
        self.order: deque[tuple[float, Any]] = deque()

    def put(self, payload: Any, now_s: float) -> None:
        """Record a message just before it is published."""
        if self.lasting.maxlen:
            self.lasting.append(payload)
            return
        while self.order and (now_s - self.order[0][0] > ECHO_S or len(self.order) >= MAX_ECHOES):
            self._drop(self.order.popleft()[1])
        self.order.append((now_s, payload))
        self.waiting[payload] = self.waiting.get(payload, 0) + 1

    def own(self, payload: Any, now_s: float) -> bool:
        """Return whether a received message is our own come back; each counts once, unless it is latched."""
        if self.lasting.maxlen:
            return payload in self.lasting
        while self.order and now_s - self.order[0][0] > ECHO_S:
            self._drop(self.order.popleft()[1])
        if payload not in self.waiting:
            return False
        self._drop(payload)
        return True

    def _drop(self, payload: Any) -> None:
        left = self.waiting.get(payload, 0) - 1
        if left > 0:
            self.waiting[payload] = left
        else:
            self.waiting.pop(payload, None)


class Loop:
    """One shared output on one side.

    Attributes:
        said, filled: our messages on the public topic and on the private topic of this side.
        heard_s: when the replica of this side last published each frame.
        period_s: usual time between two transforms of each frame.
        strange: number of messages that were not transforms although frames are declared.
        undeclared: frames that the replica published without a declaration.
        taken_s: when another node last published each frame of the group on the public topic of this side.
    """

    def __init__(self, spec: OutputSpec) -> None:
        self.topic = spec.shown
        self.frames = {(frame.parent, frame.child) for frame in spec.frames}
        self.said = Echoes(latched=spec.latched)
        self.filled = Echoes(latched=spec.latched)
        self.heard_s: dict[str, float] = {}
        self.period_s: dict[str, float] = {}
        self.strange = 0
        self.undeclared: set[str] = set()
        self.taken_s: dict[str, float] = {}

    def say(self, payload: Any, now_s: float) -> None:
        """Record a message just before it is published on the public topic."""
        self.said.put(payload, now_s)

    def others(self, payload: Any, now_s: float) -> Any | None:
        """Return the part of a public-topic message that others published, to fill in on the private topic, or None.

        The group's own frames are left out whoever publishes them: a frame has one parent.
        """
        if self.said.own(payload, now_s):
            return None

        def theirs(transform: Transform) -> bool:
            if not self._declared(transform):
                return True
            self.taken_s[f"{transform.parent} -> {transform.child}"] = now_s
            return False

        return self._fill(self._only(payload, theirs), now_s)

    def taken(self, side: Site, nodes: Collection[str], now_s: float) -> tuple[str, str] | None:
        """Return the problem that another node publishes frames of the group; None if none does.

        Args:
            side: this side.
            nodes: full names of the other nodes that publish the public topic; a message does not name its publisher.
            now_s: the steady clock.
        """
        frames = ", ".join(sorted(frame for frame, at_s in self.taken_s.items() if now_s - at_s <= TAKEN_S))
        if not frames:
            return None
        culprit = f"{'one of ' if len(nodes) > 1 else ''}{', '.join(sorted(nodes))}" or "a node that is gone"
        where = "on the robot" if side is Site.ROBOT else "in the cloud"
        return Problem.FRAME_TAKEN, f"{frames} of the group is published on {self.topic} {where} also by {culprit}"

    def replica(self, payload: Any, now_s: float) -> Any | None:
        """Return the part of a private-topic message that the replica itself published, or None."""
        if self.filled.own(payload, now_s):
            return None
        if not self.frames:
            return payload

        def ours(transform: Transform) -> bool:
            if not self._declared(transform):
                self.undeclared.add(f"{transform.parent} -> {transform.child}")
                return False
            self._heard(transform.child, now_s)
            return True

        return self._only(payload, ours)

    def _heard(self, child: str, now_s: float) -> None:
        """Record that the replica has published a frame, and its period."""
        if child in self.heard_s:
            distance_s = now_s - self.heard_s[child]
            usual_s = FADING * self.period_s.get(child, 0.0)
            self.period_s[child] = max(distance_s if distance_s <= OWN_FRAME_S else 0.0, usual_s)
        self.heard_s[child] = now_s

    def _publishes(self, child: str, now_s: float) -> bool:
        """Return whether the replica of this side currently publishes a frame itself."""
        if child not in self.heard_s:
            return False
        period_s = self.period_s.get(child, OWN_FRAME_S)
        return now_s - self.heard_s[child] <= min(OWN_FRAME_S, OWN_PERIODS * period_s + OWN_JITTER_S)

    def holder(self, payload: Any, now_s: float) -> Any | None:
        """Return the part of a passed message of the other side to fill in on this side, or None."""
        return self._fill(self._only(payload, lambda t: not self._publishes(t.child, now_s)), now_s)

    def far(self, payload: Any, now_s: float) -> Any | None:
        """Return what to fill in here in the cloud of a message that others published on the robot."""
        return self._fill(payload, now_s)

    def _fill(self, payload: Any | None, now_s: float) -> Any | None:
        if payload is not None:
            self.filled.put(payload, now_s)
        return payload

    def _declared(self, transform: Transform) -> bool:
        return (transform.parent, transform.child) in self.frames

    def _only(self, payload: Any, wanted: Any) -> Any | None:
        if not self.frames:
            return payload
        try:
            return transforms.only(payload, wanted)
        except TransformsError:
            self.strange += 1
            return None
