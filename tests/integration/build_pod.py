"""The place of a build Job's containers, made by hand on this machine: their user, capabilities, files and folders.

Nothing of it outlives its command: mounts are in a namespace of their own.
"""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

from robot_offload.render import build_scripts as scripts

_TERMINATION_LOG = "/dev/termination-log"
# As in the builder's image, which is Fedora's. Debian's are setuid root instead, and root without CAP_DAC_OVERRIDE may
# not write the id map of somebody else's process.
_FILE_CAPABILITIES = {"newuidmap": 7, "newgidmap": 6}
_ACCOUNTS = {
    "passwd": "root:x:0:0::/:/bin/sh\nbuild:x:1000:1000::/:/bin/sh\nnobody:x:65534:65534::/:/bin/sh\n",
    "group": "root:x:0:\nbuild:x:1000:\nnobody:x:65534:\n",
    "subuid": "build:100000:65536\n",
    "subgid": "build:100000:65536\n",
}


def why_not() -> str | None:
    """Why this machine cannot run the containers with buildah; None: it can."""
    if os.geteuid() != 0:
        return "needs root to give the builder its user and its capabilities"
    missing = [name for name in ("buildah", "newuidmap", "newgidmap", "setpriv", "unshare") if not shutil.which(name)]
    return f"lacks {', '.join(missing)} (packages buildah, uidmap, util-linux)" if missing else None


def _with_capability(name: str, target: Path, capability: int) -> None:
    """A copy of a program with one capability in its file instead of the setuid bit."""
    shutil.copyfile(str(shutil.which(name)), target)
    target.chmod(0o755)
    # struct vfs_cap_data, revision 2, with the effective bit (linux/capability.h).
    os.setxattr(target, "security.capability", struct.pack("<5I", 0x02000001, 1 << capability, 0, 0, 0))


class BuildPod:
    """The Pod of one build Job.

    Attributes:
        folder: stands for the root folders of its containers.
        environment: variables beside those of the containers.
    """

    def __init__(self, folder: Path, spec: dict[str, Any], files: dict[str, str]) -> None:
        self.folder = folder
        self.environment: dict[str, str] = {}
        self._containers = {each["name"]: each for each in [*spec["initContainers"], *spec["containers"]]}
        self._moved = {
            name: folder / name.strip("/").replace("/", "-")
            for name in (scripts.SCRATCH, scripts.FILES_DIR, "/tmp/push", _TERMINATION_LOG)
        }
        for name, text in _ACCOUNTS.items():
            (folder / name).write_text(text)
        for name, capability in _FILE_CAPABILITIES.items():
            _with_capability(name, folder / name, capability)
        for name in (scripts.SCRATCH, scripts.FILES_DIR):
            self._moved[name].mkdir()
        # As the kubelet makes an emptyDir of a Pod with an fsGroup: its files are of that group.
        os.chown(self._moved[scripts.SCRATCH], 0, 1000)
        self._moved[scripts.SCRATCH].chmod(0o2777)
        for name, text in files.items():
            (self._moved[scripts.FILES_DIR] / name).write_text(text)
        folder.chmod(0o777)

    def run(self, name: str, secrets: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
        """Runs one container to its end, with the files of its Secret."""
        container = self._containers[name]
        security = container["securityContext"]
        where = scripts.GIT_SECRET_DIR if name == "fetch" else scripts.REGISTRY_SECRET_DIR
        secret = self.folder / f"secret-{name}"
        secret.mkdir(exist_ok=True)
        for entry, text in (secrets or {}).items():
            (secret / entry).write_text(text)
        script = container["args"][0].replace(where, str(secret)).replace("sleep 5", "sleep 0")
        for place, moved in self._moved.items():
            script = script.replace(place, str(moved))
        granted = ",".join(f"+{one.lower()}" for one in security["capabilities"].get("add", ()))
        flags = [f"--bounding-set=-all{',' if granted else ''}{granted}", "--inh-caps=-all", "--groups=1000"]
        if not security["allowPrivilegeEscalation"]:
            flags.append("--no-new-privs")
        files = {file: f"/etc/{file}" for file in _ACCOUNTS} | {it: str(shutil.which(it)) for it in _FILE_CAPABILITIES}
        mounts = "".join(f"mount --bind {self.folder}/{file} {place}; " for file, place in files.items())
        mounted = {mount["mountPath"] for mount in container["volumeMounts"]}
        # What the container does not mount is read-only, as its root file system is.
        mounts += "".join(
            f"mount -t tmpfs -o mode=1777,{'rw' if place in mounted else 'ro'} tmpfs {place}; "
            for place in (scripts.UNPACKED_DIR, "/run", "/home")
        )
        user = f"--reuid={security['runAsUser']} --regid={security['runAsGroup']}"
        entry = f'set -e; {mounts} exec setpriv {user} {" ".join(flags)} /bin/sh -c "$SCRIPT"'
        environment = {one["name"]: one["value"] for one in container["env"]}
        return subprocess.run(
            ["unshare", "--mount", "--propagation", "private", "/bin/sh", "-c", entry],
            env={"PATH": os.environ["PATH"], "SCRIPT": script, **self.environment, **environment},
            cwd="/",
            capture_output=True,
            text=True,
            timeout=280,
            check=False,
        )

    @property
    def told(self) -> str:
        """The termination message."""
        return self._moved[_TERMINATION_LOG].read_text()

    def file(self, name: str) -> str:
        """A file of the folder that the containers share."""
        return (self._moved[scripts.SCRATCH] / name).read_text().strip()
