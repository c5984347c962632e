"""Two sides compare the parameters of their replicas: by digests, and one by one only where these differ."""

from __future__ import annotations

from robot_offload_core.control.nodes import replica_parameters
from robot_offload_core.control.nodes.replica_parameters import MAX_STATED, Compared, Table, counts, value_digest
from robot_offload_core.fence.token import Site
from robot_offload_core.words.parameters import MAX_SHOWN

TABLE = {"rate_hz": "aa", "speed": "bb"}
OTHER = {"rate_hz": "cc", "speed": "bb", "window": "dd"}


class Sides:
    """Two sides that exchange what they state."""

    def __init__(self, robot: dict[str, Table], cloud: dict[str, Table]) -> None:
        self.robot, self.cloud = Compared(robot), Compared(cloud)
        self.tables = 0

    def talk(self, rounds: int = 4) -> None:
        """Lets both state what they have; what is lost is stated again, so once is as good as ten times."""
        for _ in range(rounds):
            said = replica_parameters.statements(self.robot)
            answered = replica_parameters.statements(self.cloud)
            self.tables = sum(one.table is not None for one in (*said.values(), *answered.values()))
            self.robot = replica_parameters.heard(self.robot, answered)
            self.cloud = replica_parameters.heard(self.cloud, said)

    def found(self, *alike: str) -> dict[str, tuple[str, ...]]:
        both = [replica_parameters.differences(side, alike) for side in (self.robot, self.cloud)]
        assert both[0] == both[1]
        return both[0]


def test_equal_replicas_state_one_digest_each_and_nothing_differs() -> None:
    sides = Sides({"walker": TABLE}, {"walker": dict(reversed(TABLE.items()))})
    sides.talk()
    assert (sides.tables, sides.found("walker")) == (0, {})


def test_both_sides_name_what_differs_and_then_state_no_tables_any_more() -> None:
    sides = Sides({"walker": TABLE, "arm": TABLE}, {"walker": OTHER, "arm": OTHER})
    sides.talk(1)
    sides.talk(1)
    assert sides.tables == 2  # one node at a time
    sides.talk(6)
    assert (sides.tables, sides.found()) == (0, {"walker": ("rate_hz",), "arm": ("rate_hz",)})


def test_a_parameter_that_one_replica_alone_has_counts_where_both_are_in_one_state() -> None:
    sides = Sides({"walker": TABLE}, {"walker": OTHER})
    sides.talk()
    assert sides.found("walker") == {"walker": ("rate_hz", "window")}


def test_a_difference_that_was_mended_is_none_as_soon_as_the_digests_say_so() -> None:
    sides = Sides({"walker": TABLE}, {"walker": OTHER})
    sides.talk()
    assert replica_parameters.unlike(sides.robot, "walker")
    sides.cloud = replica_parameters.read(sides.cloud, "walker", TABLE)
    sides.talk(1)
    assert sides.found("walker") == {}
    assert not replica_parameters.unlike(sides.robot, "walker")


def test_a_node_that_does_not_answer_is_not_compared() -> None:
    sides = Sides({"walker": TABLE}, {"walker": OTHER})
    sides.talk()
    sides.cloud = replica_parameters.read(sides.cloud, "walker", None)
    sides.talk(2)
    assert sides.found("walker") == {}


def test_of_a_node_with_very_many_parameters_the_first_ones_are_compared() -> None:
    names = [f"p{number:04}" for number in range(MAX_STATED + 50)]
    ours, theirs = dict.fromkeys(names, "aa"), {**dict.fromkeys(names, "aa"), "p0003": "bb", names[-1]: "bb"}
    sides = Sides({"walker": ours}, {"walker": theirs})
    sides.talk()
    assert sides.found("walker") == {"walker": ("p0003",)}


def test_a_message_names_the_first_parameters_and_counts_the_others() -> None:
    names = tuple(f"p{number}" for number in range(MAX_SHOWN + 3))
    found = replica_parameters.problem({"walker": names, "arm": ("reach",)})
    assert found is not None
    assert "walker (p0, p1, " in found[1]
    assert "and 3 more); arm (reach)" in found[1]
    assert replica_parameters.problem({}) is None


def test_what_must_differ_does_not_count() -> None:
    assert not counts("qos_overrides./offload/robot/command.publisher.depth", ())
    assert not counts("FollowPath.max_speed", ("FollowPath.*",))
    assert counts("use_sim_time", ("speed",))


def test_the_private_topics_of_both_sides_count_as_one() -> None:
    values = [(4, f"/offload/{side.value}/cmd_vel") for side in Site]
    assert value_digest(values[0], Site.ROBOT) == value_digest(values[1], Site.CLOUD)
    assert value_digest((4, "/cmd_vel"), Site.ROBOT) != value_digest((4, "/cmd"), Site.CLOUD)
