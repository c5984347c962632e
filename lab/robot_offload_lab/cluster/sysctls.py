"""Settings of the whole machine that a cluster changes: saved by the first cluster, restored by the last."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from robot_offload_lab.cluster.layout import STATE

_PROC = Path("/proc/sys")
_KEPT = STATE / "sysctls.json"
_CHANGED_BY_KUBELET = ("vm/overcommit_memory", "vm/panic_on_oom", "kernel/panic", "kernel/panic_on_oops")
# In a container of kind, systemd applies Debian's settings, and some of them affect the whole machine.
_CHANGED_BY_SYSTEMD = (
    "kernel/pid_max",
    *(f"fs/protected_{what}" for what in ("fifos", "hardlinks", "regular", "symlinks")),
)
RAISED: Mapping[str, int] = {"fs/inotify/max_user_instances": 8192, "fs/inotify/max_user_watches": 524288}


def keep_and_raise() -> None:
    """Save the settings unless a cluster already did, and raise limits that several kubelets exhaust."""
    if not _KEPT.exists():
        names = (*_CHANGED_BY_KUBELET, *_CHANGED_BY_SYSTEMD, *RAISED)
        values = {name: (_PROC / name).read_text().strip() for name in names if (_PROC / name).exists()}
        scratch = _KEPT.with_suffix(".partial")
        scratch.write_text(json.dumps(values))
        scratch.replace(_KEPT)
    for name, least in RAISED.items():
        if int((_PROC / name).read_text()) < least:
            (_PROC / name).write_text(str(least))


def put_back() -> None:
    """Restore the settings from before the first cluster."""
    if not _KEPT.exists():
        return
    for name, value in json.loads(_KEPT.read_text()).items():
        (_PROC / name).write_text(value)
    _KEPT.unlink()


def changed() -> list[str]:
    """Return the names of settings that differ from those before the first cluster."""
    if not _KEPT.exists():
        return []
    return [
        name for name, value in json.loads(_KEPT.read_text()).items() if (_PROC / name).read_text().strip() != value
    ]
