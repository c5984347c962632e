"""What the operator makes to build the images of the sample that asks for it, as a person can read and compare it."""

from __future__ import annotations

import datetime

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.decide.builds import Before, decide
from robot_offload.objects.parent import Parent
from tests.golden.differences import dump
from tests.golden.recorded import compare
from tests.golden.test_children import FACTS, HERE, SAMPLES

BEGINNING = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def test_the_build_of_the_sample_is_as_recorded() -> None:
    offload = parse_object(SAMPLES["built"], "built")
    made = decide(Parent(offload, FACTS), Before({}, (), frozenset(), BEGINNING), "").manifests
    compare(HERE.parent / "builds" / "built.yaml", dump(made))
