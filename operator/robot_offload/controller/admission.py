"""Checks whether the admission policy is in force, for objects that may have been written without it."""

from __future__ import annotations

from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.controller.clock import Clock
from robot_offload.decide import admission
from robot_offload.errors import SpecError
from robot_offload.kube.kinds import ADMISSION_BINDING, ADMISSION_POLICY
from robot_offload.kube.port import KubeApi, Manifest

KNOWN_S: Final = 60.0
"""Seconds for which a reading of the policy is reused."""


class NotAdmittedError(SpecError):
    """No policy has checked whether the writer of an object may ask for what it names."""


class Admission:
    """The admission policy as last read.

    Attributes:
        name: of the policy and of its binding; empty: objects are not checked.
    """

    def __init__(self, api: KubeApi, clock: Clock, name: str) -> None:
        self.name = name
        self._api = api
        self._clock = clock
        self._known: admission.InForce | None = None
        self._until_s = float("-inf")

    async def check(self, raw: Manifest, offload: RobotOffload, source: str) -> None:
        """Refuse an object that the policy has not judged.

        Raises:
            NotAdmittedError: the object asks for what the policy guards, and may have been written without the policy.
            KubeError: the API server refuses or does not answer.
        """
        if not self.name or not admission.asks(offload):
            return
        found = admission.finding(raw, offload, self.name, await self._policy())
        if found is not None:
            self._until_s = float("-inf")
            raise NotAdmittedError(source, [found])

    async def _policy(self) -> admission.InForce | None:
        if self._clock.steady_s() >= self._until_s:
            policy = await self._api.get(ADMISSION_POLICY, None, self.name)
            binding = await self._api.get(ADMISSION_BINDING, None, self.name)
            self._known = admission.in_force(policy, binding)
            self._until_s = self._clock.steady_s() + KNOWN_S
        return self._known
