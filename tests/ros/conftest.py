"""Fixtures of the tests of the Zenoh link: certificates, a free port, and ends that are closed afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robot_offload.local.certificates import CertificatePaths
from tests.ros.ports import free_port
from tests.ros.zenoh_ends import Ends, new_certificates


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
