"""Makes everything that a release publishes, as CI of any forge can call it; publishes nothing.

Images are built and pushed before (`make images REGISTRY=... ARGS="--push --digests dist/digests.txt"`); with their
digests the release names each image by what it is, without them by its tag.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from robot_offload_lab.cluster import programs
from scripts import dist, install_manifest
from scripts.release import images, pins, plugin, sbom

ROOT: Final = Path(__file__).resolve().parents[2]
CHART: Final = ROOT / "charts" / "robot-offload"
REGISTRY: Final = "registry.robotoffload.dev"
DIGESTS: Final = "digests.txt"
CHECKSUMS: Final = "checksums.txt"
URL: Final = "https://robotoffload.dev/releases/v{version}"


def main(arguments: list[str] | None = None) -> int:
    """Make the release; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m scripts.release", description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder to write to (default: dist)")
    parser.add_argument("--registry", default=REGISTRY, help=f"where the images are (default: {REGISTRY})")
    parser.add_argument("--url", default=URL, help=f"of the folder where the release will be; default: {URL}")
    chosen = parser.parse_args(arguments)
    output: Path = chosen.output.resolve()
    try:
        known = images.digests(output / DIGESTS)
    except images.DigestsError as error:
        _say(str(error))
        return 2
    dist.main(["--output", str(output)])
    release(output, chosen.registry.rstrip("/"), chosen.url, known)
    if not known:
        _say(f"The images are named by their tags: there is no {output / DIGESTS} of pushed ones")
    for path in sorted(output.iterdir()):
        _say(str(path))
    return 0


def release(output: Path, registry: str, url: str, known: dict[str, str]) -> None:
    """Write everything but the wheels, which are there already, and their checksums at last."""
    version = chart_version()
    epoch_s = int(dist.committed_at())
    helm = programs.ensure(_say, {"helm": programs.CONTROL_PLANE["helm"]}).path("helm")
    values = images.values(registry, version, known)
    for old in (*output.glob("*.tgz"), *output.glob(f"{plugin.PLUGIN}-*.tar.gz")):
        old.unlink()
    subprocess.run([str(helm), "package", str(CHART), "--destination", str(output)], check=True, capture_output=True)
    (output / "install.yaml").write_text(install_manifest.rendered(helm, values), encoding="utf-8")
    (output / "values-images.json").write_text(json.dumps(nested(values), indent=2) + "\n", encoding="utf-8")
    references = images.references(registry, version, known)
    (output / "images.txt").write_text("".join(f"{one}\n" for one in sorted(references.values())), encoding="utf-8")
    shutil.copy2(ROOT / "manifests" / "argocd" / "health.lua", output / "argocd-health.lua")
    plugin.archive(output, ROOT / "operator", ROOT / "LICENSE", epoch_s)
    text = plugin.manifest(output, version, url.format(version=version))
    (output / "krew-offload.yaml").write_text(text, encoding="utf-8")
    pinned = pins.read((ROOT / "requirements" / "all.txt").read_text(encoding="utf-8"))
    made = datetime.fromtimestamp(epoch_s, UTC)
    bill = sbom.sbom(version, sorted(output.glob("*.whl")), references, pinned, made)
    (output / "sbom.cdx.json").write_text(bill, encoding="utf-8")
    (output / CHECKSUMS).write_text(checksums(output), encoding="utf-8")


def chart_version() -> str:
    """Return the version that the chart installs."""
    lines = (CHART / "Chart.yaml").read_text(encoding="utf-8").splitlines()
    return next(line.split(":", 1)[1].strip().strip('"') for line in lines if line.startswith("appVersion:"))


def nested(values: dict[str, str]) -> dict[str, object]:
    """Return dotted chart values as the blocks that `helm --values` reads."""
    found: dict[str, object] = {}
    for key, value in values.items():
        block = found
        *path, last = key.split(".")
        for part in path:
            inner = block.setdefault(part, {})
            assert isinstance(inner, dict)
            block = inner
        block[last] = value
    return found


def checksums(folder: Path) -> str:
    """Return the SHA-256 of every file of a folder, as `sha256sum --check` reads them."""
    paths = [path for path in sorted(folder.iterdir()) if path.is_file() and path.name not in (CHECKSUMS, DIGESTS)]
    return "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in paths)


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")
