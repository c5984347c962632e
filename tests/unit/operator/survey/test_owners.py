"""Which process runs which node."""

import pytest

from robot_offload.survey.owners import owners
from robot_offload.survey.snapshot import ProcessSeen
from tests.unit.operator.survey.graphs import graph, node, process

LOOKER = "010f78fd0900" + "0" * 12


def of(pid: int, host: str = "78fd") -> tuple[str, ...]:
    return (f"010f{host}{pid.to_bytes(2, 'little').hex()}" + "0" * 12,)


def found(participants: tuple[str, ...], *processes: ProcessSeen) -> int | None:
    seen = graph([node("/ns/walker", participants=participants)], processes=processes, participant=LOOKER)
    it = owners(seen).process.get("/ns/walker")
    return it.pid if it else None


def test_fast_dds_says_the_number_of_the_process() -> None:
    assert found(of(4711), process(4711, "a"), process(4712, "b")) == 4711


def test_numbers_above_65535_are_known_by_their_lower_half() -> None:
    assert found((f"010f78fd{(70000 & 0xFFFF).to_bytes(2, 'little').hex()}" + "0" * 12,), process(70000, "a")) == 70000


def test_a_process_in_a_container_is_known_by_its_number_there() -> None:
    inside = process(30001, "a").model_copy(update={"inner_pid": 7})
    assert found(of(7), inside) == 30001


def test_the_same_number_on_another_host_is_another_process() -> None:
    assert found(of(4711, host="0001"), process(4711, "a")) is None


@pytest.mark.parametrize(
    "command",
    [
        ("/lib/x/y", "--ros-args", "-r", "__node:=walker"),
        ("/lib/x/y", "--ros-args", "-r", "old:__node:=walker", "-r", "__ns:=/ns"),
        ("/usr/bin/python3", "/somewhere/walker.py"),
        ("/lib/x/walker", "--ros-args"),
    ],
    ids=" ".join,
)
def test_other_middlewares_leave_the_command_line(command: tuple[str, ...]) -> None:
    assert found(("0110" + "0" * 20,), process(3, *command), process(4, "/lib/x/other")) == 3


def test_a_namespace_on_the_command_line_must_be_the_nodes() -> None:
    assert found((), process(3, "/lib/x/y", "--ros-args", "-r", "__node:=walker", "-r", "__ns:=/other")) is None


def test_two_programs_of_one_name_are_not_guessed_between() -> None:
    assert found((), process(3, "/a/walker"), process(4, "/b/walker")) is None


def test_components_share_their_container_evenly() -> None:
    seen = graph(
        [node("/a", participants=of(5)), node("/b", participants=of(5))],
        processes=[process(5, "/opt/ros/jazzy/lib/rclcpp_components/component_container", cpu=0.5)],
        participant=LOOKER,
    )
    owned = owners(seen)
    assert (owned.cpu("/a"), owned.cpu("/b"), owned.whole["/b"]) == (0.25, 0.25, "/b")
