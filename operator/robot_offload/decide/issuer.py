"""Certificates from the user's own issuer: objects of cert-manager instead of our authorities.

cert-manager then writes the Secrets of cloud and robot. Each side trusts the issuer's own authority and requires the
common name of the other side, which contains name and namespace of the RobotOffload. So one issuer may sign for many
robots, as long as it issues such names to no other client.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from robot_offload.decide.certificates import Leaf, Role, host_names, secret_name
from robot_offload.decide.ownership import APPLIED
from robot_offload.decide.renewal import Answer, digest
from robot_offload.decide.verdicts import Verdict, no, yes
from robot_offload.kube.kinds import CERTIFICATE
from robot_offload.kube.port import Manifest
from robot_offload.objects.labels import labels
from robot_offload.objects.parent import Parent, Part

WRITTEN_BY: Final = "cert-manager.io/certificate-name"
"""Annotation of cert-manager on the Secrets that it writes."""


def certificates(parent: Parent) -> tuple[Manifest, ...]:
    """Return the Certificates of cloud and robot; only for a RobotOffload that names an issuer."""
    cloud = {
        "usages": ["digital signature", "server auth"],
        # A robot that dials an address instead of a declared name checks this name.
        "commonName": parent.certificate_name("cloud"),
        "dnsNames": list(host_names(parent.offload, parent.namespace)),
    }
    robot = {"usages": ["digital signature", "client auth"], "commonName": parent.certificate_name("robot")}
    return (_certificate(parent, "cloud", cloud), _certificate(parent, "robot", robot))


def answer(request: str) -> Answer:
    """Return the answer to a robot that requests a certificate: we cannot sign with the issuer's authority."""
    return Answer(
        digest(request),
        "OwnIssuer",
        "The robot's certificate comes from your own issuer, which signs for keys made in the cluster; write the "
        "bundle again before it ends",
    )


def verdict(secrets: Mapping[Role, Manifest | None]) -> Verdict:
    """Return whether the issuer has delivered (condition CertificatesReady)."""
    for role in ("cloud", "robot"):
        data = (secrets.get(role) or {}).get("data") or {}
        missing = [key for key in ("tls.crt", "tls.key", "ca.crt") if not data.get(key)]
        if missing:
            return no(
                "WaitingForIssuer",
                f"cert-manager has not written {', '.join(missing)} of the {role}'s certificate yet; "
                "look at its Certificate and the issuer (the issuer must give its own authority: ca.crt)",
            )
    return yes("IssuedByIssuer", "The certificates come from the named issuer, which renews them")


def _certificate(parent: Parent, role: Leaf, usage: Mapping[str, Any]) -> Manifest:
    settings = parent.spec.transport.certificates
    assert settings.issuer_ref is not None
    name = secret_name(parent.name, role)
    spec: Manifest = {
        "secretName": name,
        # With our labels and our mark, the Secret is recognized as ours if the issuer is dropped again.
        "secretTemplate": {
            "labels": labels(parent.offload, "certificates"),
            "annotations": {APPLIED: f"{parent.uid}/issuer"},
        },
        "duration": f"{settings.duration_ms // 1000}s",
        "renewBefore": f"{settings.renew_before_ms // 1000}s",
        "privateKey": {"algorithm": "ECDSA", "size": 256, "encoding": "PKCS8", "rotationPolicy": "Always"},
        "issuerRef": {
            "name": settings.issuer_ref.name,
            "kind": settings.issuer_ref.kind,
            "group": "cert-manager.io",
        },
        **usage,
    }
    return parent.child(CERTIFICATE, Part(name, "certificates"), {"spec": spec})
