"""Tests with real processes: certificates, free ports and link ends for them, and a second chance on a busy machine.

A virtual machine that stands still for a third of a second fails a test of ours without a fault of ours. Such a test
runs once more, and the summary lists it (`RERUN`). A broken rule of the switch is never given a second chance.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robot_offload_lab.run.certificates import CertificatePaths
from tests.ros.ports import free_port
from tests.ros.zenoh_ends import Ends, new_certificates


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests that start real processes."""
    for item in items:
        if "tests/ros/" in str(item.path):
            item.add_marker(pytest.mark.flaky(reruns=1, rerun_except=["ViolationError", "violations"]))


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> CertificatePaths:
    return new_certificates(tmp_path_factory.mktemp("certificates"))


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def ends() -> Iterator[Ends]:
    made = Ends()
    yield made
    made.close()
