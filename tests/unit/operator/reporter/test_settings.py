"""What the reporter is told by its environment."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload.reporter.settings import ReporterSettings, read_settings

COMPLETE = {
    "NAMESPACE": "ward",
    "LEASE_NAME": "w-robot",
    "ROBOT_NAME": "w",
    "STATE_FILE": "/run/robot-offload/state.json",
    "HANDOVER_FILE": "/run/robot-offload/handover",
    "HANDOVER_PROOF": "proof",
}


def test_the_environment_of_the_pod_is_enough() -> None:
    files = Path("/run/robot-offload/state.json"), Path("/run/robot-offload/handover")
    assert read_settings(COMPLETE) == ReporterSettings("ward", "w-robot", "w", *files, "proof", port=8080)


def test_everything_that_is_missing_is_told_at_once() -> None:
    with pytest.raises(InputError, match="lacks LEASE_NAME, STATE_FILE;"):
        read_settings(COMPLETE | {"LEASE_NAME": "", "STATE_FILE": ""})


@pytest.mark.parametrize("port", ["http", "-1", "65536", "80.5"])
def test_a_port_that_is_none_is_refused(port: str) -> None:
    with pytest.raises(InputError, match="PORT"):
        read_settings(COMPLETE | {"PORT": port})
