"""Computing resources of containers."""

from __future__ import annotations

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.names import LabelKey
from robot_offload.api.v1alpha1.quantities import Quantity


class Resources(Model):
    """Computing resources of a container."""

    limits: dict[LabelKey, Quantity] = Field(
        default_factory=dict,
        max_length=16,
        description="The most that it may use, e.g. {memory: 1Gi, nvidia.com/gpu: 1}. Default: none.",
    )
    requests: dict[LabelKey, Quantity] = Field(
        default_factory=dict,
        max_length=16,
        description="What is set aside for it, e.g. {cpu: 500m, memory: 512Mi}. Default: the limits.",
    )
