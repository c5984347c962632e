"""Write manifests/install.yaml: what the chart renders with its default values, for those who do not use helm.

The definition of RobotOffload is not in it: manifests/crd has that. The install.yaml of a release has both.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from robot_offload_lab.cluster import programs

ROOT = Path(__file__).parents[1]
CHART = ROOT / "charts" / "robot-offload"
TARGET = ROOT / "manifests" / "install.yaml"
NAMESPACE = "robot-offload-system"
HEAD = """\
# Robot Offload, generated from charts/robot-offload (scripts/install_manifest.py). Install or upgrade:
#   kubectl apply --server-side {files}
# Removing the definition of RobotOffload removes every RobotOffload. To keep them, delete only the Deployment, the
# roles and the bindings: the namespace has the keys of the robots' authorities.
apiVersion: v1
kind: Namespace
metadata:
  name: {namespace}
  labels:
    pod-security.kubernetes.io/enforce: restricted
"""


def rendered(helm: Path, values: Mapping[str, str] = MappingProxyType({}), *, definition: bool = True) -> str:
    """Return the text of the file, with other values (by their dotted names) where they are given.

    Without `definition` the CustomResourceDefinition is left out.
    """
    command = [str(helm), "template", "robot-offload", str(CHART), "--namespace", NAMESPACE]
    command += ["--set", f"crds.install={json.dumps(definition)}"]
    command += [part for key, value in values.items() for part in ("--set-string", f"{key}={value}")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"helm template failed: {done.stderr}")
    body = done.stdout.replace("app.kubernetes.io/managed-by: Helm", "app.kubernetes.io/managed-by: kubectl")
    files = "-f install.yaml" if definition else "-f manifests/crd -f manifests/install.yaml"
    return HEAD.format(files=files, namespace=NAMESPACE) + body


def main() -> int:
    """Write the file, or with --check say whether it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing; fail when the file is not up to date")
    text = rendered(programs.ensure(_say, {"helm": programs.CONTROL_PLANE["helm"]}).path("helm"), definition=False)
    if not parser.parse_args().check:
        TARGET.parent.mkdir(exist_ok=True)
        TARGET.write_text(text)
        return 0
    if TARGET.exists() and TARGET.read_text() == text:
        return 0
    _say(f"{TARGET.relative_to(ROOT)} is not what the chart renders. Next: python -m scripts.install_manifest")
    return 1


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


if __name__ == "__main__":
    sys.exit(main())
