"""Names of children: they fit Kubernetes whatever the resource and its nodes are called, and never meet."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.objects.names import child_name, discovery_child, node_child

OFFLOADS = st.from_regex(r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?", fullmatch=True)
NODES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,62}", fullmatch=True)
WORDS = st.sampled_from(["agent", "settings", "router", "udp", "tcp", "nodes", "robot", "cloud", "server-ca"])
SERVICE = re.compile(r"[a-z]([-a-z0-9]*[a-z0-9])?")


def test_ordinary_names_are_what_a_person_expects() -> None:
    assert child_name("wheelchair-7", "agent") == "wheelchair-7-agent"
    assert node_child("wheelchair-7", "talker") == "wheelchair-7-talker"
    assert re.fullmatch(r"wheelchair-7-map-server-[0-9a-f]{8}", node_child("wheelchair-7", "map_server"))
    assert discovery_child("wheelchair-7", 1) == "wheelchair-7-discovery-1"


def test_a_long_name_is_cut_and_stays_the_same_for_ever() -> None:
    name = child_name("r" * 63, "agent")
    assert name == "r" * 54 + "-" + name[-8:]
    assert len(name) == 63
    assert name == child_name("r" * 63, "agent")


def test_two_long_names_that_differ_only_at_the_end_stay_two() -> None:
    assert child_name("r" * 63, "agent") != child_name("r" * 63, "nodes")
    assert node_child("r" * 50, "a" * 40 + "x") != node_child("r" * 50, "a" * 40 + "y")


def test_a_resource_that_begins_with_a_digit_gets_names_that_a_service_may_have() -> None:
    assert child_name("7-of-nine", "udp").startswith("r-7-of-nine-udp-")


@pytest.mark.parametrize(
    ("one", "other"),
    [("Talker", "talker"), ("talker_", "talker"), ("_talker", "talker"), ("_", "__"), ("map_Server", "map_server")],
)
def test_nodes_that_would_meet_once_dashes_replace_underscores_do_not(one: str, other: str) -> None:
    assert node_child("r", one) != node_child("r", other)


@pytest.mark.parametrize(
    "word", ["agent", "router", "settings", "discovery_0", "udp", "images", "build", "build_controller"]
)
def test_a_node_that_is_called_like_a_child_of_ours_gets_another_name(word: str) -> None:
    assert node_child("r", word) != child_name("r", word.replace("_", "-"))


def test_the_name_of_a_stateful_set_leaves_room_for_what_kubernetes_adds() -> None:
    assert len(discovery_child("r" * 63, 3)) <= 52


@given(OFFLOADS, WORDS)
def test_every_name_fits_a_service_and_a_label(offload: str, word: str) -> None:
    name = child_name(offload, word)
    assert len(name) <= 63
    assert SERVICE.fullmatch(name)


@given(OFFLOADS, st.lists(NODES, min_size=2, max_size=8, unique=True))
def test_no_two_nodes_of_a_resource_share_a_name_and_none_takes_ours(offload: str, nodes: list[str]) -> None:
    names = [node_child(offload, node) for node in nodes]
    assert len(set(names)) == len(nodes)
    assert all(len(name) <= 63 and SERVICE.fullmatch(name) for name in names)
    assert not set(names) & {child_name(offload, word) for word in ("agent", "router")}


OWN = ("agent", "settings", "dds", "router", "nodes", "udp", "tcp", "robot", "cloud", "server-ca", "client-ca")
PIECES = st.lists(
    st.sampled_from(["a", "x", "agent", "server", "ca", "0", "1a2b3c4d", "ab12cd34"]), min_size=1, max_size=4
)


@given(PIECES, st.integers(1, 3), st.integers(1, 3))
def test_two_resources_never_want_one_name_wherever_their_names_end(pieces: list[str], first: int, other: int) -> None:
    one, two = (("-".join(pieces[:cut]), "_".join(pieces[cut:])) for cut in (first, other))
    if one[0] == two[0]:
        return
    own = {child_name(two[0], word) for word in OWN} | {discovery_child(two[0], number) for number in range(2)}
    theirs = own | ({node_child(*two)} if two[1] else set())
    assert not one[1] or node_child(*one) not in theirs


@pytest.mark.parametrize("node", ["x_agent", "x_server_ca", "x_discovery_0", "x_talker"])
def test_no_node_takes_a_name_of_another_resource(node: str) -> None:
    name = node_child("fleet", node)
    assert name not in {child_name("fleet-x", word) for word in OWN}
    assert name != node_child("fleet-x", "talker")


def test_a_node_cannot_be_named_like_the_hash_of_another_resources_node() -> None:
    taken = node_child("fleet", "map_server")
    place, _, digest = taken.rpartition("-")
    assert node_child(place, digest) != taken
    assert node_child("walker-server", "ca") != child_name("walker", "server-ca")
