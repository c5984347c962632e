"""A small RobotOffload and its facts, for the tests of decisions."""

from __future__ import annotations

import datetime
from typing import Any

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.objects.facts import Facts, Images

NOW = datetime.datetime(2026, 11, 21, 12, tzinfo=datetime.UTC)
IMAGES = Images(agent="agent:1", operator="operator:1", discovery="discovery:1", router="router:1", git="git:1")
FACTS = Facts(
    namespace="fleet",
    uid="u-1",
    generation=3,
    images=IMAGES,
    nodes_wanted=True,
    discovery_hosts=("10.96.0.8", "10.96.0.9"),
)


def offload(**spec: Any) -> RobotOffload:
    """A RobotOffload named walker with one duplicated node; keywords are parts of its spec."""
    return parse_object(
        {
            "apiVersion": "robotoffload.dev/v1alpha1",
            "kind": "RobotOffload",
            "metadata": {"name": "walker"},
            "spec": {
                "nodes": [
                    {
                        "name": "talker",
                        "placement": "Duplicated",
                        "image": "talker:1",
                        "run": {"package": "demo_nodes_cpp", "executable": "talker"},
                    }
                ],
                **spec,
            },
        },
        "test",
    )


def lease(holder: str | None = "walker", renewed: str = "1", **annotations: str) -> dict[str, Any]:
    """The robot's Lease as the reporter writes it."""
    return {
        "metadata": {"name": "walker-robot", "annotations": annotations},
        "spec": {"holderIdentity": holder, "renewTime": renewed, "leaseDurationSeconds": 30},
    }
