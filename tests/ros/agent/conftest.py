"""Worlds for the tests of the agent.

Starting two agents and two nodes takes some seconds, so tests that leave a pair of agents as they found it share one
per link (`world`, `ros_world`). Before each such test the world is put into order (everything runs, nothing is cut, no
override), and after it every message that reached the consumer meanwhile is judged. Tests with a set-up of their own
use `build`.
"""

from collections.abc import Callable, Iterator

import pytest

from tests.ros.agent.harness import Plan, World
from tests.ros.agent.shared import Shared, judged

ROBOT_DOMAIN, CLOUD_DOMAIN = 71, 72
OWN_DOMAINS = (73, 74)
ROS_LINK_DOMAIN = 75
ROUTER_DOMAINS = (76, 77)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests of this folder and puts those together that share a world."""
    ours = [item for item in items if "tests/ros/agent" in str(item.path)]
    for item in ours:
        item.add_marker(pytest.mark.ros)
        # The first use of a message type imports the wheels' old parser, which says so.
        item.add_marker(pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning"))
    places = [index for index, item in enumerate(items) if item in ours]
    for place, item in zip(places, sorted(ours, key=group), strict=True):
        items[place] = item


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    """Closes the shared world behind the last test of this folder: those of the demo come next and watch the clock."""
    if nextitem is None or "tests/ros/agent" not in str(nextitem.path):
        Shared.close_present()


def group(item: pytest.Item) -> int:
    """Tests of one number share a world, or have each their own."""
    fixtures = getattr(item, "fixturenames", ())
    if "ros_world" in fixtures:
        return 1
    if "routed_world" in fixtures:
        return 2
    if "own" in fixtures:
        return 3
    if "serving_world" in fixtures:
        return 5
    return 0 if "world" in fixtures else 4


@pytest.fixture(scope="session")
def zenoh_shared() -> Iterator[Shared]:
    shared = Shared(Plan(domains=(ROBOT_DOMAIN, CLOUD_DOMAIN)))
    yield shared
    shared.close()


@pytest.fixture(scope="session")
def serving_shared() -> Iterator[Shared]:
    shared = Shared(Plan(domains=(ROBOT_DOMAIN, CLOUD_DOMAIN), serves=True, files=True))
    yield shared
    shared.close()


@pytest.fixture
def serving_world(serving_shared: Shared) -> Iterator[World]:
    """Both agents over Zenoh, the cloud in charge; the replicas serve two actions and two services."""
    yield from judged(serving_shared)


@pytest.fixture(scope="session")
def ros_shared() -> Iterator[Shared]:
    shared = Shared(Plan(domains=(ROS_LINK_DOMAIN, ROS_LINK_DOMAIN), link="ros"))
    yield shared
    shared.close()


@pytest.fixture
def world(zenoh_shared: Shared) -> Iterator[World]:
    """Both agents over Zenoh, the cloud in charge."""
    yield from judged(zenoh_shared)


@pytest.fixture
def ros_world(ros_shared: Shared) -> Iterator[World]:
    """The same over DDS between two network namespaces."""
    yield from judged(ros_shared)


@pytest.fixture(scope="session")
def router_shared() -> Iterator[Shared]:
    shared = Shared(Plan(domains=ROUTER_DOMAINS, link="router"))
    yield shared
    shared.close()


@pytest.fixture
def routed_world(router_shared: Shared) -> Iterator[World]:
    """The same over two DDS Routers and the tunnel between two network namespaces."""
    yield from judged(router_shared)


@pytest.fixture
def build() -> Iterator[Callable[..., World]]:
    """Makes worlds of one's own; nothing is started in them. `build(robot={...}, fed=False, ...)`, see Plan."""
    worlds: list[World] = []
    Shared.close_present()

    def make(**plan: object) -> World:
        world = World(Plan(**{"domains": OWN_DOMAINS, **plan}))  # type: ignore[arg-type]
        world.__enter__()
        worlds.append(world)
        return world

    yield make
    for world in worlds:
        world.close()
