"""How kopf is set up."""

from __future__ import annotations

import itertools

import kopf

from robot_offload import handlers
from robot_offload.kube.kinds import CHILD_KINDS, CONFIG_MAP, POD
from robot_offload.objects.facts import default_images
from robot_offload.runtime.settings import Settings

SETTINGS = Settings(default_images("1"), "system", "operator-0", inactivity_s=42.0)


def configured() -> kopf.OperatorSettings:
    settings = kopf.OperatorSettings()
    handlers.configure(settings, SETTINGS)
    return settings


def test_the_api_server_sends_only_what_belongs_to_us_and_users_config_maps() -> None:
    watching = configured().watching
    for kind in (*CHILD_KINDS, POD):
        resource = kind.api_version, kind.plural
        if kind == CONFIG_MAP:
            assert watching.field_selectors[resource] == "metadata.name!=kube-root-ca.crt"
        else:
            assert watching.label_selectors[resource] == "app.kubernetes.io/managed-by=robot-offload"
    assert watching.inactivity_timeout == 42.0


def test_what_cannot_be_watched_now_is_tried_for_ever_at_most_five_seconds_apart() -> None:
    pauses = list(itertools.islice(handlers.Patience(), 1000))
    assert pauses[:5] == [0.5, 1.0, 2.0, 4.0, 5.0]
    assert set(pauses[4:]) == {5.0}


def test_kopf_keeps_nothing_on_any_object() -> None:
    persistence = configured().persistence
    body = kopf.Body({"metadata": {"name": "walker", "annotations": {"mine": "stays"}}})
    patch = kopf.Patch()
    essence = persistence.diffbase_storage.build(body=body)
    persistence.diffbase_storage.store(body=body, patch=patch, essence=essence)
    persistence.progress_storage.touch(body=body, patch=patch, value="now")
    assert not patch
