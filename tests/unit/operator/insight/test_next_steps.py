"""Every next step leads somewhere: its command exists, and following it never comes back to where one was."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from robot_offload.api.v1alpha1.status import CLOUD_TYPES
from robot_offload.cli.main import app
from robot_offload.insight.explanation import BUNDLE_NEEDS, explain
from robot_offload.insight.next_steps import NEXT_STEPS, asks_for_bundle
from robot_offload.insight.observed import Observed
from tests.unit.operator.cli.resources import NOW, observed

COMMAND = re.compile(r"(?:kubectl offload|robot-offload) ([a-z-]+)((?: +[A-Za-z{}/-]+)*)")


@pytest.mark.parametrize("reason", sorted(NEXT_STEPS))
def test_every_command_of_a_next_step_exists_with_its_options(reason: str) -> None:
    for name, rest in COMMAND.findall(NEXT_STEPS[reason].step):
        shown = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"})
        assert shown.exit_code == 0, shown.output
        assert {word for word in rest.split() if word.startswith("-")} <= set(
            re.findall(r"(?<!\S)--?[a-z-]+", shown.output)
        )


@pytest.mark.parametrize("reason", ["InProgress", "CertificatesPending", "AddressPending"])
def test_what_a_bundle_waits_for_does_not_lead_back_to_explain_or_bundle(reason: str) -> None:
    assert NEXT_STEPS[reason].step
    assert not COMMAND.search(NEXT_STEPS[reason].step)


@pytest.mark.parametrize("type_", BUNDLE_NEEDS)
def test_while_no_bundle_can_be_written_no_step_asks_for_one(type_: str) -> None:
    reason = {"SpecValid": "TooShort", "CertificatesReady": "WaitingForIssuer"}.get(type_, "AddressPending")
    robot = {"Connected": ("False", "NeverConnected", ""), "CertificateCurrent": ("False", "Expired", "")}
    found = followed(observed(**{type_: ("False", reason, "why"), "Ready": ("False", reason, "why"), **robot}))
    assert found
    assert not any(asks_for_bundle(step) for step in found)


def test_what_explain_calls_ready_gives_a_bundle_its_addresses() -> None:
    assert "AddressesReady" in CLOUD_TYPES
    connected = observed(Connected=("False", "NeverConnected", "no robot"))
    assert any(asks_for_bundle(step) for step in followed(connected))


def followed(offload: Observed) -> list[str]:
    """The next steps of `explain`."""
    return [problem.step for problem in explain(offload, deleting=False, events=(), now=NOW).problems]
