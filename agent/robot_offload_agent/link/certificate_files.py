"""Checks of certificate files without a network."""

from __future__ import annotations

import ssl
from pathlib import Path

from robot_offload_agent.link.zenoh_config import ZenohSettings


def certificate_problem(settings: ZenohSettings) -> str:
    """Return what is wrong with the certificate files (missing, unreadable, not made for each other), else "".

    Args:
        settings: of the link; the files are read anew each time.
    """
    for name in ("ca", "certificate", "private_key"):
        path = Path(getattr(settings, name))
        try:
            path.read_bytes()
        except OSError as error:
            return f"{name} {path}: {error.strerror}"
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(settings.ca)
    except ssl.SSLError:
        return f"ca {settings.ca}: holds no certificate in PEM form"
    try:
        context.load_cert_chain(settings.certificate, settings.private_key)
    except ssl.SSLError as error:
        return f"certificate {settings.certificate} and private_key {settings.private_key}: {error.reason or error}"
    return ""
