"""The robot's certificates on its disk, below the folder that outlives a reboot.

    certificates/current -> bundle, or the serial number of the newest own one; read by the links and the tunnel
    certificates/bundle/robot.pem, robot.key -> the files of the bundle
    certificates/1f3a.../robot.pem, robot.key    an own key and its certificate
    certificates/next/robot.key, request         an own key that has no certificate yet

`current` is replaced in one step, so both files of a pair change together. A failure to store something never stops
the robot: it runs with its bundle's files then.
"""

from __future__ import annotations

import base64
import logging
import os
import shutil
from dataclasses import replace
from pathlib import Path

from robot_offload_agent.certificates import openssl
from robot_offload_agent.certificates.openssl import Certificate, CertificateError
from robot_offload_agent.settings.files import read_text, write_whole
from robot_offload_agent.settings.override import state_dir
from robot_offload_agent.settings.parameters import Configuration

log = logging.getLogger(__name__)

CERTIFICATE = "robot.pem"
KEY = "robot.key"
REQUEST = "request"
CURRENT = "current"
BUNDLE = "bundle"
NEXT = "next"


class Wallet:
    """The folder of certificates. Its methods block on the disk and on `openssl`: never call them on a deciding thread.

    Attributes:
        folder: see the module's docstring.
    """

    def __init__(self, configuration: Configuration) -> None:
        self.folder = state_dir(configuration) / "certificates"
        self._name = str(configuration["robot_name"]) or "robot"

    def choose(self, bundled: Path, bundled_key: Path) -> tuple[Path, Path]:
        """Select the newest pair as the current one and return the permanent paths of its files.

        Args:
            bundled: the certificate of the bundle.
            bundled_key: its key.

        Raises:
            CertificateError: no certificate can be read here.
            OSError: the folder cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        bundle = self.folder / BUNDLE
        bundle.mkdir(exist_ok=True)
        for name, target in ((CERTIFICATE, bundled), (KEY, bundled_key)):
            _link(bundle / name, target.absolute())
        # A bundle written after the robot's own certificate was signed marks a new start: it takes precedence.
        found = {BUNDLE: openssl.look(bundle / CERTIFICATE).begin_s}
        for own in self._own():
            try:
                found[own.name] = openssl.look(own / CERTIFICATE).begin_s
            except CertificateError as error:
                log.warning("Left out %s: %s", own, error)
        newest = max(found, key=lambda name: (found[name], name != BUNDLE))
        _link(self.folder / CURRENT, Path(newest))
        self._clear(newest)
        return self.folder / CURRENT / CERTIFICATE, self.folder / CURRENT / KEY

    def present(self) -> tuple[Certificate, bool]:
        """Return the current certificate, and whether it is the bundle's; raise CertificateError."""
        current = self.folder / CURRENT
        return openssl.look(current / CERTIFICATE), current.resolve().name == BUNDLE

    def request(self) -> str:
        """Make a key and return the request for its certificate; return the same until it is kept or dropped.

        A request outlives a restart: its answer may be on its way, and is given once for each certificate.

        Raises:
            CertificateError: the key cannot be made.
            OSError: it cannot be stored.
        """
        place, current = self.folder / NEXT, self.folder / CURRENT
        with_serial = openssl.look(current / CERTIFICATE).serial
        try:
            serial, text = read_text(place / REQUEST).split()
            if serial == with_serial:
                return text
        except (OSError, ValueError):
            pass  # there is none yet
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(mode=0o700)
        openssl.make_key(place / KEY)
        asked = openssl.signing_request(place / KEY, self._name)
        parts = (asked, openssl.der(current / CERTIFICATE), openssl.prove(current / KEY, asked))
        text = ".".join(base64.b64encode(part).decode() for part in parts)
        _sync(place / KEY)
        write_whole(place / REQUEST, f"{with_serial} {text}", durable=True)
        return text

    def keep(self, pem: str) -> Certificate:
        """Make a certificate that was signed for the next key the current one; return it.

        Raises:
            CertificateError: it is not for that key.
            OSError: it cannot be stored.
        """
        place = self.folder / NEXT
        write_whole(place / CERTIFICATE, pem, durable=True)
        if not openssl.belong_together(place / CERTIFICATE, place / KEY):
            raise CertificateError("the certificate that came is not for this robot's key")
        found = openssl.look(place / CERTIFICATE)
        own = self.folder / found.serial
        (place / REQUEST).unlink(missing_ok=True)
        place.replace(own)
        _link(self.folder / CURRENT, Path(own.name))
        self._clear(own.name)
        return found

    def drop(self) -> None:
        """Delete the key that waits for a certificate: the next request is for another one."""
        shutil.rmtree(self.folder / NEXT, ignore_errors=True)

    def _own(self) -> list[Path]:
        folders = [path for path in self.folder.iterdir() if path.name not in (BUNDLE, NEXT, CURRENT) and path.is_dir()]
        return [path for path in folders if openssl.belong_together(path / CERTIFICATE, path / KEY)]

    def _clear(self, newest: str) -> None:
        """Remove own pairs that are no longer used."""
        for own in self._own():
            if own.name != newest:
                shutil.rmtree(own, ignore_errors=True)


def with_own_certificate(configuration: Configuration) -> Configuration:
    """Return the robot's configuration with the files of its newest certificate; unchanged if that is not possible."""
    bundled, key = configuration["link.certificate"], configuration["link.private_key"]
    if configuration["side"] != "robot" or not (bundled and key):
        return configuration
    try:
        certificate, own_key = Wallet(configuration).choose(Path(bundled), Path(key))
    except (CertificateError, OSError) as error:
        log.warning("The robot keeps the certificate of its bundle and cannot renew it: %s", error)
        return configuration
    values = {**configuration.values, "link.certificate": str(certificate), "link.private_key": str(own_key)}
    return replace(configuration, values=values)


def renews(configuration: Configuration) -> bool:
    """Return whether `with_own_certificate` has found a place for own certificates."""
    return Path(configuration["link.certificate"]).parent == state_dir(configuration) / "certificates" / CURRENT


def _link(path: Path, target: Path) -> None:
    """Make or replace a symbolic link in one step."""
    if path.is_symlink() and path.readlink() == target:
        return
    passing = path.with_name(f"{path.name}.new")
    passing.unlink(missing_ok=True)
    passing.symlink_to(target)
    passing.replace(path)


def _sync(file: Path) -> None:
    with file.open("rb") as opened:
        os.fsync(opened.fileno())
