"""etcd, kube-apiserver and kube-controller-manager on free ports of the loopback interface, as any user."""

from __future__ import annotations

import base64
import json
import secrets
import shutil
import ssl
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Self

import yaml
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from robot_offload_lab.cluster import processes
from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.programs import Programs

CONTROLLERS = (
    "garbage-collector-controller",
    "namespace-controller",
    "serviceaccount-controller",
    "root-ca-certificate-publisher-controller",
    "deployment-controller",
    "replicaset-controller",
    "statefulset-controller",
    "job-controller",
    "endpointslice-controller",
)
AUDIT_POLICY = {
    "apiVersion": "audit.k8s.io/v1",
    "kind": "Policy",
    "omitStages": ["RequestReceived"],
    "rules": [{"level": "Metadata"}],
}
PATIENCE = 120.0  # seconds; a start takes five, but the machine may be busy with a build


class ControlPlane:
    """One control plane and the directory that holds its files.

    Attributes:
        directory: All files of this control plane; removed by `stop`.
        url: URL of the API server.
        token: Bearer token of a cluster administrator.
        kubeconfig: File for that administrator.
        ca_file: Certificate with which clients verify the API server.
        host: Address on which the API server listens.
        within: Command prefix that runs the servers where they belong; empty: here.
        favoured: Whether the servers take precedence over other programs on a busy machine.
    """

    host = "127.0.0.1"
    within: tuple[str, ...] = ()
    favoured = False

    def __init__(self, directory: Path, programs: Programs) -> None:
        self.directory = directory
        self.programs = programs
        self.kubeconfig = directory / "kubeconfig"
        self.ca_file = directory / "certs" / "apiserver.crt"
        self.token = ""
        self.url = ""
        self._servers: dict[str, subprocess.Popen[bytes]] = {}

    @classmethod
    def of_directory(cls, directory: Path, programs: Programs) -> ControlPlane:
        """Return the control plane that another process started in a directory."""
        return cls(directory, programs).attached()

    def attached(self) -> Self:
        """Return this one after reading how to talk to it, as written by the process that started it."""
        try:
            config = json.loads(self.kubeconfig.read_text())
        except FileNotFoundError:
            raise ClusterError(
                f"No test cluster in {self.directory}; next: python -m robot_offload_lab.cluster up"
            ) from None
        self.url = config["clusters"][0]["cluster"]["server"]
        self.token = config["users"][0]["user"]["token"]
        return self

    def start(self, definitions: Sequence[Path] = (), *, die_with_us: bool = True) -> Self:
        """Start everything and return when a Deployment could be served.

        Args:
            definitions: CustomResourceDefinition files. They are applied before kube-controller-manager starts: its
                garbage collector looks for new kinds only now and then, and children of a later kind would be collected
                40 s late the first time.
            die_with_us: No process outlives the thread that calls this; otherwise they run until `stop`.
        """
        try:
            self._start_api(die_with_us=die_with_us)
            if definitions:
                self._define(definitions)
            self._start_controllers(die_with_us=die_with_us)
        except BaseException:
            self.stop()
            raise
        return self

    @contextmanager
    def running(self, definitions: Sequence[Path] = ()) -> Iterator[Self]:
        """Start, and stop at the end of the block."""
        self.start(definitions)
        try:
            yield self
        finally:
            self.stop()

    def stop(self) -> None:
        """End every process of this directory, whatever started it, and remove the directory."""
        self._kill()
        shutil.rmtree(self.directory, ignore_errors=True)

    def kubectl(self, namespace: str = "default") -> Kubectl:
        """Run kubectl as the administrator."""
        return Kubectl(self.programs.path("kubectl"), self.kubeconfig, namespace)

    def helm(self, namespace: str = "default") -> Helm:
        """Run helm as the administrator."""
        return Helm(self.programs.path("helm"), self.kubeconfig, namespace)

    def kubeconfig_of(self, namespace: str, service_account: str) -> Path:
        """Return a kubeconfig with the rights of a ServiceAccount, and no others."""
        token = self.kubectl(namespace)("create", "token", service_account, "--duration=1h").strip()
        path = self.directory / f"kubeconfig-{namespace}-{service_account}"
        self._write_kubeconfig(path, token, namespace)
        return path

    def new_namespace(self, name: str, pod_security: str = "") -> str:
        """Make a namespace and wait until a Pod could be made in it.

        Args:
            name: Of the namespace.
            pod_security: The standard that is enforced there; empty for none.
        """
        labels = {"pod-security.kubernetes.io/enforce": pod_security} if pod_security else {}
        metadata = {"name": name, "labels": labels}
        self.request("POST", "/api/v1/namespaces", {"apiVersion": "v1", "kind": "Namespace", "metadata": metadata})
        # Controllers make these a moment later; a Pod is refused until its ServiceAccount exists.
        for each in ("serviceaccounts/default", "configmaps/kube-root-ca.crt"):
            self._wait(each, partial(self._exists, f"/api/v1/namespaces/{name}/{each}"))
        return name

    def wait_served(self, definition: Mapping[str, Any]) -> None:
        """Wait until the API server serves the kind of a CustomResourceDefinition."""
        spec = definition["spec"]
        plural, version = spec["names"]["plural"], spec["versions"][0]["name"]
        self._wait(f"{plural} to be served", partial(self._exists, f"/apis/{spec['group']}/{version}/{plural}"))

    def audit(self) -> Iterator[dict[str, Any]]:
        """Yield the API server's requests, oldest first: audit.k8s.io/v1 events with metadata only."""
        with (self.directory / "audit.jsonl").open() as lines:
            for line in lines:
                if line.endswith("\n"):  # the last one may be incomplete
                    yield json.loads(line)

    def get(self, path: str) -> str:
        """Get a path of the API server as the administrator; return the answer."""
        return self.request("GET", path)

    def request(self, verb: str, path: str, body: Any = None, content_type: str = "application/json") -> str:
        """Send any request as the administrator; raise HTTPError when it is refused."""
        request = urllib.request.Request(
            self.url + path,
            method=verb,
            data=None if body is None else json.dumps(body).encode(),
            headers={"Authorization": f"Bearer {self.token}", "Content-Type": content_type},
        )
        with self.opener().open(request, timeout=60) as answer:
            return str(answer.read().decode())

    def opener(self) -> urllib.request.OpenerDirector:
        """Return an opener of requests to this API server, without a proxy."""
        trust = ssl.create_default_context(cafile=str(self.ca_file))
        direct = urllib.request.ProxyHandler({})
        return urllib.request.build_opener(direct, urllib.request.HTTPSHandler(context=trust))

    def _exists(self, path: str) -> bool:
        return bool(self.get(path))

    def _start_api(self, *, die_with_us: bool, attempts: int = 3) -> None:
        """Start etcd and kube-apiserver; start again with other ports if another program has taken one."""
        for attempt in range(1, attempts + 1):
            shutil.rmtree(self.directory, ignore_errors=True)
            self.directory.mkdir(parents=True, mode=0o700)
            self._write_secrets()
            etcd, api = self._ports()
            self.url = f"https://{self.host}:{api}"
            # Both at once: the API server tries again until etcd answers.
            self._spawn("etcd", self._etcd_settings(etcd), die_with_us=die_with_us)
            self._spawn("kube-apiserver", self._api_settings(api, etcd), die_with_us=die_with_us)
            try:
                self._wait("the API server to be ready", lambda: self.get("/readyz") == "ok")
                break
            except ClusterError as error:
                if attempt == attempts or "address already in use" not in str(error):
                    raise
                self._kill()
        self._write_kubeconfig(self.kubeconfig, self.token, "default")

    def _write_secrets(self) -> None:
        self.token = secrets.token_hex(16)
        (self.directory / "tokens.csv").write_text(f'{self.token},admin,admin,"system:masters"\n')
        (self.directory / "audit-policy.json").write_text(json.dumps(AUDIT_POLICY))
        key = ec.generate_private_key(ec.SECP256R1()).private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.TraditionalOpenSSL,
            serialization.NoEncryption(),
        )
        (self.directory / "service-accounts.key").write_bytes(key)

    def _ports(self) -> list[int]:
        """Return the ports of etcd and the API server."""
        return processes.free_ports(2)

    def _etcd_settings(self, port: int) -> dict[str, str]:
        url = f"http://127.0.0.1:{port}"
        return {
            "data-dir": f"{self.directory}/etcd",
            "listen-client-urls": url,
            "advertise-client-urls": url,
            "listen-peer-urls": "http://127.0.0.1:0",
            "unsafe-no-fsync": "true",  # nothing here has to survive a power cut
            "log-level": "warn",
        }

    def _api_settings(self, port: int, etcd_port: int) -> dict[str, str]:
        key = f"{self.directory}/service-accounts.key"
        return {
            "bind-address": self.host,
            "advertise-address": self.host,
            "secure-port": str(port),
            "cert-dir": f"{self.directory}/certs",
            "etcd-servers": f"http://127.0.0.1:{etcd_port}",
            "endpoint-reconciler-type": "none",
            "service-cluster-ip-range": "10.96.0.0/16",
            "authorization-mode": "RBAC",
            # As in OpenShift: a user who sets an owner that blocks deletion needs the right to set its finalizers.
            "enable-admission-plugins": "OwnerReferencesPermissionEnforcement",
            "token-auth-file": f"{self.directory}/tokens.csv",
            "service-account-issuer": "https://kubernetes.default.svc.cluster.local",
            "service-account-key-file": key,
            "service-account-signing-key-file": key,
            "audit-policy-file": f"{self.directory}/audit-policy.json",
            "audit-log-path": f"{self.directory}/audit.jsonl",
            "allow-privileged": "true",
            "profiling": "false",
        }

    def _define(self, definitions: Sequence[Path]) -> None:
        for path in definitions:
            self.kubectl()("apply", "--server-side", "-f", str(path))
            self.wait_served(yaml.safe_load(path.read_text()))

    def _start_controllers(self, *, die_with_us: bool) -> None:
        self._spawn("kube-controller-manager", self._controller_settings(), die_with_us=die_with_us)
        account = "/api/v1/namespaces/default/serviceaccounts/default"
        self._wait("the controllers to work", partial(self._exists, account))

    def _controller_settings(self) -> dict[str, str]:
        return {
            "kubeconfig": str(self.kubeconfig),
            "controllers": ",".join(CONTROLLERS),
            "service-account-private-key-file": f"{self.directory}/service-accounts.key",
            "root-ca-file": str(self.ca_file),
            "leader-elect": "false",
            "secure-port": "0",
        }

    def _write_kubeconfig(self, path: Path, token: str, namespace: str) -> None:
        authority = base64.b64encode(self.ca_file.read_bytes()).decode()
        name = "robot-offload-test"
        config = {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": name, "cluster": {"server": self.url, "certificate-authority-data": authority}}],
            "users": [{"name": name, "user": {"token": token}}],
            "contexts": [{"name": name, "context": {"cluster": name, "user": name, "namespace": namespace}}],
            "current-context": name,
        }
        path.write_text(json.dumps(config, indent=1))
        path.chmod(0o600)

    def _spawn(self, name: str, settings: Mapping[str, str], *, die_with_us: bool) -> None:
        command = [*self.within, str(self.programs.path(name)), *(f"--{key}={word}" for key, word in settings.items())]
        log = self.directory / f"{name}.log"
        self._servers[name] = processes.spawn(command, log, die_with_us=die_with_us, favoured=self.favoured)

    def _kill(self) -> None:
        processes.kill(self.directory)
        for server in self._servers.values():
            server.wait()
        self._servers.clear()

    def _wait(self, what: str, happened: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while True:
            trouble = "it said no"
            try:
                if happened():
                    return
            except urllib.error.HTTPError as error:
                with error:  # it holds the connection
                    trouble = f"{error}: {error.read().decode(errors='replace')[:300]}"
            except OSError as error:
                trouble = str(error)
            for name, server in self._servers.items():
                if server.poll() is not None:
                    raise ClusterError(f"{name} ended while waiting for {what}:\n{self._log_tail(name)}")
            if time.monotonic() > deadline:
                logs = "\n".join(f"{name}: {self._log_tail(name)}" for name in self._servers)
                raise ClusterError(f"Waited {PATIENCE:.0f} s for {what}; last: {trouble}\n{logs}")
            time.sleep(0.05)

    def _log_tail(self, name: str) -> str:
        return (self.directory / f"{name}.log").read_text(errors="replace")[-3000:]
