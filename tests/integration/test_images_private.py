"""A private repository is read with a token that is lent to the build: nothing of it is in the image."""

from __future__ import annotations

import base64
import datetime
import ipaddress
import json
import os
import secrets
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from robot_offload_lab.images import wheels_base
from tests.integration import images_machine
from tests.integration.images_machine import Machine, robot_offload

pytestmark = [pytest.mark.images, pytest.mark.timeout(1200)]
TOKEN = secrets.token_hex(16)
TAG = "localhost/private:1"
TEXT = "<package format='3'><name>talker</name></package>"


class GitServer(BaseHTTPRequestHandler):
    """git's own server program behind a password."""

    root: Path

    def do_GET(self) -> None:
        self._serve(b"")

    def do_POST(self) -> None:
        self._serve(self.rfile.read(int(self.headers["Content-Length"])))

    def log_message(self, *arguments: object) -> None:
        """Says nothing."""

    def _serve(self, body: bytes) -> None:
        allowed = "Basic " + base64.b64encode(f"robot:{TOKEN}".encode()).decode()
        if self.headers.get("Authorization") != allowed:
            self.send_response(401)
            self.send_header("WWW-Authenticate", 'Basic realm="git"')
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        path, _, query = self.path.partition("?")
        environment = os.environ | {
            "GIT_PROJECT_ROOT": str(self.root), "GIT_HTTP_EXPORT_ALL": "1", "PATH_INFO": path, "QUERY_STRING": query,
            "REQUEST_METHOD": self.command, "CONTENT_TYPE": self.headers.get("Content-Type", ""),
            "CONTENT_LENGTH": str(len(body)), "HTTP_GIT_PROTOCOL": self.headers.get("Git-Protocol", ""),
            "HTTP_CONTENT_ENCODING": self.headers.get("Content-Encoding", ""),
        }  # fmt: skip
        answer = subprocess.run(("git", "http-backend"), input=body, env=environment, capture_output=True, check=False)
        head, _, content = answer.stdout.partition(b"\r\n\r\n")
        self.send_response(200)
        for line in head.decode().splitlines():
            name, _, value = line.partition(": ")
            if name != "Status":
                self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


@pytest.fixture(scope="module")
def machine() -> Iterator[Machine]:
    """A machine with the base that sources are fetched in."""
    with images_machine.machine("ros-base") as machine:
        yield machine
        machine.run("buildah", "rmi", "--force", TAG, check=False)
        machine.run("buildah", "rmi", "--prune", check=False)


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """Where the repository is served, with a certificate in `certificate.pem`."""
    folder = tmp_path / "robot.git"
    (folder / "src/talker").mkdir(parents=True)
    (folder / "src/talker/package.xml").write_text(TEXT)
    git = ("git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@example.com")
    for arguments in (("init", "-q", "-b", "main"), ("add", "."), ("commit", "-q", "-m", "a")):
        subprocess.run((*git, *arguments), check=True)
    certify(tmp_path)
    with serving(tmp_path, tmp_path) as url:
        yield f"{url}/robot.git"


@contextmanager
def serving(root: Path, certificates: Path, address: str = "127.0.0.1") -> Iterator[str]:
    """Serves the repositories in a folder, to who has the token; where."""
    server = ThreadingHTTPServer((address, 0), type("Served", (GitServer,), {"root": root}))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificates / "certificate.pem", certificates / "key.pem")
    server.socket = context.wrap_socket(server.socket, server_side=True)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"https://{address}:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def certify(folder: Path, address: str = "127.0.0.1", days: int = 1) -> None:
    """A certificate for an address of this machine, in `certificate.pem` with `key.pem`."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "git server of a test")])
    now = datetime.datetime.now(datetime.UTC)
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
    certificate = (
        builder.not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=days))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address(address))]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    encoding, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    (folder / "certificate.pem").write_bytes(certificate.public_bytes(encoding))
    (folder / "key.pem").write_bytes(key.private_bytes(encoding, serialization.PrivateFormat.PKCS8, plain))


def command(folder: Path, address: str, token: str) -> tuple[str, ...]:
    """A build of the sources with a token."""
    (folder / "token").write_text(address.replace("https://", f"https://robot:{token}@").rsplit("/", 1)[0] + "\n")
    lent = (
        "--isolation",
        "chroot",
        "--target",
        "sources",
        "--volume",
        f"{folder}/certificate.pem:{wheels_base.BUNDLE}:ro",
    )
    return robot_offload(
        "build", "--builder", "buildah", "--tag", TAG, "--base", wheels_base.tag("ros-base"), "--git", address,
        "--package", "talker", "--executable", "talker", "--credentials", "Token",
        "--secret", f"id=git-credentials,src={folder}/token", *(f"--builder-argument={word}" for word in lent),
    )  # fmt: skip


def test_the_token_opens_the_repository_and_is_nowhere_in_the_image(
    machine: Machine, address: str, tmp_path: Path
) -> None:
    machine.run(*command(tmp_path, address, TOKEN))
    with machine.mounted(TAG) as root:
        assert (root / "ws/src/src/talker/package.xml").read_text() == TEXT
        files = [path for path in root.rglob("*") if path.is_file() and not path.is_symlink()]
        changed = [
            path for path in files if path.is_relative_to(root / "ws") or "root" in path.parts or "run" in path.parts
        ]
        assert changed
        assert not [path for path in changed if TOKEN.encode() in path.read_bytes()]
    inspected = machine.run("buildah", "inspect", "--type", "image", TAG)
    assert TOKEN not in inspected
    assert json.loads(inspected)["Docker"]["config"]["Env"]


def test_without_the_right_token_the_build_says_what_git_says(machine: Machine, address: str, tmp_path: Path) -> None:
    output = machine.run(*command(tmp_path, address, "wrong"), check=False)
    assert "Authentication failed" in output or "could not read Username" in output
    assert f"buildah could not build {TAG}" in output
    assert TOKEN not in output
