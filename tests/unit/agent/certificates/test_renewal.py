"""When a robot asks for another certificate, and what becomes of the answer."""

from __future__ import annotations

import json

import pytest

from robot_offload_agent.certificates.openssl import Certificate
from robot_offload_agent.certificates.renewal import (
    RETRY_S,
    Asking,
    Command,
    Drop,
    Event,
    Failed,
    Found,
    Heard,
    Keep,
    MakeRequest,
    Renewal,
    digest,
    due,
    step,
)

DAY_S = 86_400.0
OWN = Certificate("1f", 0.0, 90 * DAY_S)


def run(*events: Event, wall_s: float, now_s: float = 10.0) -> tuple[Renewal, list[Command]]:
    state, commands = Renewal(), []
    for event in events:
        state, command = step(state, event, now_s, wall_s)
        if command is not None:
            commands.append(command)
    return state, commands


def answer(request: str, certificate: str = "", reason: str = "Issued", message: str = "") -> str:
    return json.dumps({"request": digest(request), "reason": reason, "message": message, "certificate": certificate})


def test_an_own_certificate_is_renewed_at_two_thirds_of_its_life() -> None:
    asks = [Found(OWN, bundled=False), Heard(True, "")]
    assert run(*asks, wall_s=59 * DAY_S)[1] == []
    assert run(*asks, wall_s=61 * DAY_S)[1] == [MakeRequest()]


def test_the_key_of_a_bundle_is_replaced_at_the_first_connection() -> None:
    assert run(Found(OWN, bundled=True), Heard(True, ""), wall_s=DAY_S)[1] == [MakeRequest()]


def test_nobody_is_asked_where_nobody_signs() -> None:
    assert run(Found(OWN, bundled=True), Heard(False, ""), wall_s=89 * DAY_S)[1] == []


def test_a_clock_before_the_certificate_renews_nothing() -> None:
    state, _ = run(Found(OWN, bundled=False), wall_s=0.0)
    assert not due(state, -DAY_S)


def test_the_answer_to_the_own_request_is_kept_and_ends_the_asking() -> None:
    before = [Found(OWN, bundled=True), Heard(True, ""), Asking("abc")]
    waiting, _ = run(*before, Heard(True, answer("another", "PEM")), wall_s=DAY_S)
    assert waiting.request == "abc"
    kept, commands = run(*before, Heard(True, answer("abc", "PEM")), Heard(True, answer("abc", "PEM")), wall_s=DAY_S)
    assert commands == [MakeRequest(), Keep("PEM")]
    assert not kept.request
    assert step(kept, Found(OWN, bundled=False), 0.0, 0.0)[0] == Renewal(OWN)


def test_a_refusal_is_told_and_not_asked_again_for_hours() -> None:
    events = [Found(OWN, bundled=True), Heard(True, ""), Asking("abc")]
    refusal = Heard(True, answer("abc", "", "AlreadyRenewed", "a copy is in use"))
    state, commands = run(*events, refusal, Heard(True, ""), wall_s=DAY_S)
    assert commands == [MakeRequest(), Drop()]
    assert (state.reason, state.message, state.request) == ("AlreadyRenewed", "a copy is in use", "")
    assert step(state, Heard(True, ""), 10.0 + RETRY_S, DAY_S)[1] == MakeRequest()


def test_a_full_disk_is_told_and_tried_again_later() -> None:
    state, _ = run(Found(OWN, bundled=True), Heard(True, ""), Failed("no space"), Heard(True, ""), wall_s=DAY_S)
    assert (state.reason, state.message) == ("RenewalFailed", "no space")


@pytest.mark.parametrize(
    "garbage",
    ["{", "[]", "null", "[" * 100_000, '{"request": 1}', json.dumps({"request": digest("abc")}), "x" * 20_000],
)
def test_garbage_is_no_answer(garbage: str) -> None:
    state, commands = run(Found(OWN, bundled=True), Heard(True, ""), Asking("abc"), Heard(True, garbage), wall_s=DAY_S)
    assert state.request == "abc"
    assert commands == [MakeRequest()]
