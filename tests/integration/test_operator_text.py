"""What users write reaches the cluster as it is, whatever characters it has."""

from __future__ import annotations

from copy import deepcopy

import pytest

from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, ROBOT_OFFLOAD
from tests.integration.operator_cluster import TALKER, Place

pytestmark = pytest.mark.api

ODD = "\N{ROBOT FACE} fährt 走 \x7f\x85\u2028\ufeff"
"""Beyond U+FFFF, beyond ASCII, and what YAML takes only escaped."""


def test_any_text_of_a_specification_reaches_its_objects(place: Place) -> None:
    manifest = deepcopy(TALKER)
    manifest["metadata"]["annotations"] = {"example.com/note": ODD}
    node = manifest["spec"]["nodes"][0]
    node["run"] = {"command": ["talk", ODD], "parameters": {"greeting": ODD, "names": [ODD, "plain"]}}
    node["env"] = [{"name": "GREETING", "value": ODD}]
    place.create(ROBOT_OFFLOAD, manifest)
    place.applied()
    container = place.there(DEPLOYMENT, "walker-talker")["spec"]["template"]["spec"]["containers"][0]
    assert ODD in container["args"]
    assert {"name": "GREETING", "value": ODD} in container["env"]
    assert place.list(CONFIG_MAP)
