"""The times that result from `switching.profile` and explicit values, in words. Pure and tolerant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from pydantic import ValidationError

from robot_offload.api.v1alpha1.model import yaml_name
from robot_offload.api.v1alpha1.switching import Switching

_FOLLOWING: Final = ("heartbeat_period_ms", "loss_timeout_ms", "lease_ms", "max_command_age_ms")


def timing(spec: Mapping[str, Any]) -> Iterator[str]:
    """Yield one sentence with the times in force, as the resource has them; nothing if they cannot be read."""
    given = spec.get("switching") or {}
    try:
        switching = Switching.model_validate(given)
    except ValidationError:
        return  # SpecValid reports the error
    names = [yaml_name(field) for field in _FOLLOWING]
    own = [name for name in names if name in given]
    follow = f"switching.profile is {switching.profile}"
    if own:
        follow += f", {', '.join(own)} {'are' if len(own) > 1 else 'is'} given"
    yield (
        f"{follow}: a heartbeat every {switching.heartbeat_period_ms} ms, a lost link after "
        f"{switching.loss_timeout_ms} ms, a lease of {switching.lease_ms} ms, commands at most "
        f"{switching.max_command_age_ms} ms old."
    )
