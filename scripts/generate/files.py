"""Which files are generated, and their text: pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Final

import yaml

from robot_offload.api.crd import GROUP, PLURAL, crd
from robot_offload.cli.own_images import default_images
from scripts.generate.dashboards import dashboards
from scripts.generate.metrics import metrics
from scripts.generate.reasons import reasons
from scripts.generate.reference import reference
from scripts.generate.support import support
from scripts.generate.times import times

CRD_FILE: Final = "charts/robot-offload/files/crd.yaml"
CRD_LINK: Final = f"manifests/crd/{PLURAL}.{GROUP}.yaml"
"""A link to the chart's file: for `kubectl apply -f manifests/crd`."""
REFERENCE_FILE: Final = "docs/reference/robotoffload.md"
REASONS_FILE: Final = "docs/reference/reasons.md"
IMAGES_FILE: Final = "manifests/images.txt"
SUPPORT_FILE: Final = "docs/reference/support.md"
METRICS_FILE: Final = "docs/reference/metrics.md"
TIMES_FILE: Final = "docs/reference/times.md"

_HEAD: Final = "# Generated from the models in operator/robot_offload/api by `make generate`; changes here are lost.\n"


def generated_files() -> Mapping[str, str]:
    """Return path below the repository -> text, of every generated file."""
    definition = crd()
    text = _HEAD + yaml.dump(definition, Dumper=_PlainDumper, sort_keys=False, width=110, allow_unicode=True)
    pages = {
        REFERENCE_FILE: reference(definition),
        REASONS_FILE: reasons(),
        SUPPORT_FILE: support(),
        METRICS_FILE: metrics(),
        TIMES_FILE: times(),
    }
    return {CRD_FILE: text, IMAGES_FILE: _images(), **pages, **dashboards()}


def _images() -> str:
    """Return each image that this release runs in a cluster, one a line, for registries without internet."""
    return "".join(f"{image}\n" for image in sorted(set(asdict(default_images()).values())))


class _PlainDumper(yaml.SafeDumper):
    """Writes values that occur twice twice: anchors are no help to a reader of a manifest."""

    def ignore_aliases(self, data: object) -> bool:
        return True
