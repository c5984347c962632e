"""Sites, incarnations, tokens, and the fast copy of states."""

from __future__ import annotations

import dataclasses

import pytest

from robot_offload_core.fence.token import Site, Token, is_incarnation
from robot_offload_core.words import replace
from tests.unit.core.builders import CLOUD, ROBOT, STRANGER, robot_in


@pytest.mark.parametrize("site", Site)
def test_the_other_site_of_the_other_is_oneself(site: Site) -> None:
    assert site.other is not site
    assert site.other.other is site


@pytest.mark.parametrize("text", ["0" * 32, "0123456789abcdef" * 2])
def test_thirty_two_hexadecimal_digits_are_an_incarnation(text: str) -> None:
    assert is_incarnation(text)


@pytest.mark.parametrize("text", ["", "a" * 31, "a" * 33, "A" * 32, "g" * 32, " " * 32, "\u0661" * 32])
def test_anything_else_is_none(text: str) -> None:
    assert not is_incarnation(text)


def test_tokens_are_the_same_only_in_all_three_parts() -> None:
    token = Token(ROBOT, 4, CLOUD)
    assert token == Token(ROBOT, 4, CLOUD)
    assert token not in (Token(STRANGER, 4, CLOUD), Token(ROBOT, 5, CLOUD), Token(ROBOT, 4, STRANGER))


def test_tokens_have_no_order() -> None:
    with pytest.raises(TypeError):
        _ = Token(ROBOT, 4, CLOUD) < Token(ROBOT, 5, CLOUD)  # type: ignore[operator]


def test_the_fast_copy_is_what_the_standard_library_makes() -> None:
    robot = robot_in()
    changes = {"since_s": 9.0, "hot": True}
    assert replace.replace(robot, **changes) == dataclasses.replace(robot, **changes)
    assert robot == robot_in(), "the original is untouched"


def test_the_fast_copy_refuses_a_field_that_does_not_exist() -> None:
    with pytest.raises(TypeError, match="no field epocs"):
        replace.replace(robot_in(), epocs=9)  # type: ignore[call-arg]
