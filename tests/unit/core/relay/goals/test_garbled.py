"""Whatever a hostile relay writes: the other goes on, and nothing undeclared reaches a server or a client."""

from __future__ import annotations

import random
from typing import Any

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import Face
from robot_offload_core.words.messages import Letters
from tests.unit.core.relay.goals.garbled import letters
from tests.unit.core.relay.goals.pair import ALL, CLOUD, ROBOT, Pair, Side, token

NAMES = tuple(spec.name for spec in (*ALL.services, *ALL.actions, *ALL.used_services, *ALL.used_actions))
CALLS = ("offer", "cancel", "ask_result", "call")
ANSWERS = ("answer_goal", "answer_cancel", "answer_result", "publish_feedback", "publish_status", "answer_call")


def strict(side: Side) -> None:
    """Lets the side's shell raise what a real one raises: it has entities for what is declared, and no others."""
    group = {(Face.GROUP, spec.name) for spec in (*ALL.services, *ALL.actions)}
    used = {spec.name for spec in (*ALL.used_services, *ALL.used_actions)}
    robot = side.site is Site.ROBOT
    clients = group | ({(Face.PUBLIC, name) for name in used} if robot else set())
    served = {(Face.PUBLIC, name) for _, name in group} if robot else set()
    servers = served | {(Face.GROUP, name) for name in used}

    def only(known: set[tuple[Face, str]], act: Any) -> Any:
        def checked(face: Face, name: str, *rest: Any) -> Any:
            if (face, name) not in known:
                raise KeyError((face, name))
            return act(face, name, *rest)

        return checked

    for known, names in ((clients, CALLS), (servers, ANSWERS)):
        for name in names:
            setattr(side, name, only(known, getattr(side, name)))
    side.offer = only(clients, lambda face, action, payload: None)  # type: ignore[method-assign]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("site", Site)
@pytest.mark.parametrize("holder", Site)
def test_a_hostile_relay_ends_no_other_and_reaches_only_what_is_declared(site: Site, holder: Site, seed: int) -> None:
    pair, chance = Pair(), random.Random(seed)
    if holder is Site.CLOUD:
        pair.in_cloud()
    side = pair.robot if site is Site.ROBOT else pair.cloud
    relay = side.relay
    assert relay is not None
    strict(side)
    agent = CLOUD if site is Site.ROBOT else ROBOT
    mine = relay.post.courier.mine  # type: ignore[attr-defined]
    tokens = (pair.holding.token, token(99))
    for frame in letters("fe" * 16, mine, agent, NAMES, chance, tokens, rounds=30):
        relay.handle(Letters(frame))
        pair.now += chance.choice([0.0, 0.001, 0.02, 0.3])
        pair.say()
        relay.turn()
    pair.now += 5.0
    relay.turn()
