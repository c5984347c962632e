"""A decision names the nodes and topics that it is about."""

from robot_offload_agent.control.culprits import explained
from robot_offload_core.control.nodes.managed_nodes import Node
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import NodeSpec

WALKER = Node(NodeSpec("walker", True, True, True, False), State.INACTIVE)
PLANNER = Node(NodeSpec("planner", True, False, True, False), State.ACTIVE)
CAMERA = Node(NodeSpec("camera", False, False, False, False))
NODES = (WALKER, PLANNER, CAMERA)


def said(reason: Reason, message: str = "Why", **given: object) -> str:
    known = {"nodes": NODES, "replicas": {}, "problems": (), "link": "", **given}
    return explained(reason, message, **known)  # type: ignore[arg-type]


def test_a_cloud_that_is_not_ready_names_its_nodes_that_are_not_active() -> None:
    replicas = {"walker": "active", "planner": "unconfigured"}
    assert said(Reason.CLOUD_NOT_READY, replicas=replicas) == "Why: planner is unconfigured there"
    assert said(Reason.CLOUD_NOT_READY) == "Why: walker is unknown there, planner is unknown there"


def test_a_robot_that_cannot_act_names_its_nodes_and_why_they_were_given_up() -> None:
    given_up = Node(PLANNER.spec, State.INACTIVE, gave_up="activate was refused, 9 times in 60 s")
    assert said(Reason.ROBOT_UNABLE) == "Why: walker is inactive here"
    found = said(Reason.ROBOT_UNABLE, nodes=(given_up,))
    assert found == "Why: planner is inactive here (activate was refused, 9 times in 60 s)"


def test_a_stale_input_without_a_publisher_says_that() -> None:
    problems = (("NoPublisher", "/scan has no publisher yet"), ("NoPublisher", "/odom has no publisher yet"))
    message = "Input /odom never arrived in the cloud, the limit is 400 ms"
    assert said(Reason.INPUT_STALE, message, problems=problems) == f"{message}: /odom has no publisher yet"


def test_a_cloud_that_is_not_heard_says_what_is_wrong_with_the_session() -> None:
    link = "No pulse session with quic/cloud.example:7447: its name cannot be looked up here"
    assert said(Reason.NEVER_HEARD, link=link) == f"Why: {link}"
    assert said(Reason.LINK_GOOD, link=link) == said(Reason.NEVER_HEARD) == "Why"


def test_other_decisions_and_those_without_a_culprit_stay_as_they_are() -> None:
    assert said(Reason.LINK_GOOD) == "Why"
    assert said(Reason.CLOUD_NOT_READY, replicas={"walker": "active", "planner": "active"}) == "Why"
