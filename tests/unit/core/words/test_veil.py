"""The name by which the cloud calls a robot."""

from robot_offload_core.fence.token import Token, is_incarnation
from robot_offload_core.words.veil import unveil_token, unveiled, veil_token, veiled
from tests.unit.core.builders import CLOUD, ROBOT, STRANGER


def test_a_veiled_name_has_the_form_of_an_incarnation_and_is_another_one() -> None:
    assert is_incarnation(veiled(ROBOT))
    assert veiled(ROBOT) != ROBOT
    assert veiled(ROBOT) != veiled(STRANGER)


def test_nobody_has_no_veiled_name() -> None:
    assert veiled("") == ""
    assert unveiled("", "") == ""


def test_the_robot_alone_recognises_its_name() -> None:
    assert unveiled(veiled(ROBOT), ROBOT) == ROBOT
    assert unveiled(veiled(ROBOT), STRANGER) == veiled(ROBOT)


def test_an_older_cloud_names_the_robot_as_it_is() -> None:
    assert unveiled(ROBOT, ROBOT) == ROBOT


def test_a_token_keeps_its_epoch_and_the_cloud() -> None:
    token = Token(ROBOT, 7, CLOUD)
    assert veil_token(token) == Token(veiled(ROBOT), 7, CLOUD)
    assert unveil_token(veil_token(token), ROBOT) == token
