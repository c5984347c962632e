"""What would break the cluster, another tenant or the switch is refused by `validate`, with what to write instead."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, RULES
from robot_offload.errors import SpecError
from tests.contract.hostile import HARMLESS, HOSTILE, Hostile
from tests.contract.rule_examples import BROKEN, Example, example_values


@pytest.mark.parametrize("hostile", HOSTILE, ids=lambda it: it.name)
def test_a_hostile_specification_is_refused_with_what_to_write(hostile: Hostile) -> None:
    with pytest.raises(SpecError) as caught:
        parse_object(hostile.values, "f.yaml")
    said = " ".join(finding.message for finding in caught.value.findings)
    assert hostile.advice in said
    assert all(finding.path.isascii() and "[key]" not in finding.path for finding in caught.value.findings)
    assert said.isascii()


@pytest.mark.parametrize(("path", "value"), HARMLESS)
def test_its_harmless_neighbour_is_taken(path: str, value: Any) -> None:
    parse_object(example_values(path, value), "f.yaml", rules=CLUSTER_CHECKS)


@pytest.mark.parametrize("example", BROKEN, ids=lambda it: it.name)
def test_validate_says_of_a_broken_rule_what_the_api_server_says(example: Example) -> None:

    with pytest.raises(SpecError) as caught:
        parse_object(example_values(example.path, example.value), "f.yaml", rules=CLUSTER_CHECKS)
    path, reason = example.rule
    texts = [rule.message for rule in RULES if (rule.path, rule.reason) == (path, reason)]
    found = [finding.message for finding in caught.value.findings if finding.reason == reason]
    assert any(message.startswith(tuple(texts)) for message in found), (found, texts)
