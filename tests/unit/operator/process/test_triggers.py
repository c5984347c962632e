"""How kopf is started."""

from __future__ import annotations

import asyncio
from typing import Any

import kopf
import pytest

from robot_offload.kube.port import Manifest
from robot_offload.process import triggers


class NoTriggers:
    """Nothing comes of events."""

    def resource(self, manifest: Manifest, *, gone: bool) -> None:
        raise AssertionError

    def child(self, manifest: Manifest, *, gone: bool) -> None:
        raise AssertionError

    def lease(self, manifest: Manifest, *, gone: bool) -> None:
        raise AssertionError

    def config_map(self, manifest: Manifest, *, gone: bool) -> None:
        raise AssertionError


def test_kopf_need_not_ask_for_the_name_of_a_user_that_a_pod_does_not_have(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr(kopf, "operator", lambda **options: given.update(options))
    triggers.operator(NoTriggers(), namespaces=(), inactivity_s=1.0, ready=asyncio.Event(), stop=asyncio.Event())
    assert given["identity"], "kopf would call getpass.getuser(), which fails for a user id without a name"
