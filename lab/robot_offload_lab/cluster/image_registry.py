"""A container registry beside a cluster: nodes, pods and this machine use one address for it, without encryption."""

from __future__ import annotations

import http.client
import json
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from robot_offload_lab.cluster import processes
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import Layout

PORT = 5000
PATIENCE = 60.0  # seconds for what takes less than one


class ImageRegistry:
    """The registry of one cluster; it runs within a `with` block.

    Attributes:
        address: Host and port, with which the names of its images begin.
    """

    def __init__(self, layout: Layout, program: Path, storage: Path) -> None:
        self.address = f"{layout.host}:{PORT}"
        self._layout = layout
        self._program = program
        self._storage = storage
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        settings = self._layout.home / "registry.json"
        # A JSON text is also a YAML text.
        settings.write_text(
            json.dumps(
                {
                    "version": "0.1",
                    "log": {"level": "warn", "accesslog": {"disabled": True}},
                    "storage": {"filesystem": {"rootdirectory": str(self._storage)}},
                    "http": {"addr": self.address},
                }
            )
        )
        # containerd reads it at every pull; by default it uses encryption only.
        place = self._layout.registries / self.address
        place.mkdir(parents=True, exist_ok=True)
        capabilities = 'capabilities = ["pull", "resolve"]'
        (place / "hosts.toml").write_text(f'[host."http://{self.address}"]\n{capabilities}\n')
        command = ["env", "OTEL_TRACES_EXPORTER=none", str(self._program), "serve", str(settings)]
        self._process = processes.spawn(command, self._log, die_with_us=True)
        self._wait()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def has(self, repository: str, reference: str) -> bool:
        """Return whether an image is there.

        Args:
            repository: Without the registry's address.
            reference: A tag or a digest.
        """
        return self._ask("HEAD", f"/v2/{repository}/manifests/{reference}") == http.client.OK

    @property
    def _log(self) -> Path:
        return self._layout.home / "registry.log"

    def _wait(self) -> None:
        assert self._process is not None
        deadline = time.monotonic() + PATIENCE
        while self._process.poll() is None and time.monotonic() < deadline:
            try:
                if self._ask("GET", "/v2/") == http.client.OK:
                    return
            except OSError:  # it does not listen yet
                time.sleep(0.05)
        raise ClusterError(f"The registry does not answer: {self._log.read_text(errors='replace')[-2000:]}")

    def _ask(self, method: str, path: str) -> int:
        accepted = "application/vnd.oci.image.manifest.v1+json, application/vnd.docker.distribution.manifest.v2+json"
        connection = http.client.HTTPConnection(self.address, timeout=PATIENCE)
        try:
            connection.request(method, path, headers={"Accept": accepted})
            return connection.getresponse().status
        finally:
            connection.close()
