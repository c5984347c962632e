"""Hashes of what a pod reads when it starts: a change rolls exactly the pods that read it."""

from __future__ import annotations

import hashlib
import json
from typing import Any, Final

ANNOTATION: Final = "robotoffload.dev/config-hash"
"""On pod templates: Kubernetes replaces a pod if its template changes."""
_LENGTH: Final = 16


def config_hash(*read: Any) -> str:
    """Return 16 hexadecimal digits that depend on all of `read` (plain values; the order of keys does not matter)."""
    canonical = json.dumps(read, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:_LENGTH]
