"""What the operator's tests ask of a control plane, and how they wait: for a state, never for a time."""

from __future__ import annotations

import datetime
import json
import re
import time
import urllib.error
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, TypeVar

from robot_offload.decide.authorities import secret_names
from robot_offload.kube.kinds import CHILD_KINDS, DEPLOYMENT, LEASE, ROBOT_OFFLOAD, SECRET, Kind
from robot_offload.render import handover
from robot_offload_lab.cluster.control_plane import ControlPlane

Manifest = dict[str, Any]
Found = TypeVar("Found")
HOME = "default"
"""Where the operators of the tests are at home."""
PATIENCE_S = 60.0  # the machine may stand still for a moment at any time

TALKER: Manifest = {
    "apiVersion": "robotoffload.dev/v1alpha1",
    "kind": "RobotOffload",
    "metadata": {"name": "walker"},
    "spec": {
        "robot": {"domainID": 7},
        "nodes": [
            {
                "name": "talker",
                "placement": "Duplicated",
                "core": True,
                "run": {"package": "demo_nodes_cpp", "executable": "talker"},
                "image": "registry.example/talker:1",
                "outputs": [{"topic": "/chatter", "type": "std_msgs/msg/String", "rate": 10}],
            }
        ],
    },
}


def walker(name: str = "walker", **spec: Any) -> Manifest:
    """A small RobotOffload; keywords replace fields of its spec."""
    manifest = deepcopy(TALKER)
    manifest["metadata"]["name"] = name
    manifest["spec"].update(spec)
    return manifest


def eventually(look: Callable[[], Found], what: str, instead: Callable[[], object] | None = None) -> Found:
    """The first result of `look` that is true; fails with `what` and what is there instead."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        found = look()
        if found:
            return found
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {PATIENCE_S:g} s for {what}; there is {instead() if instead else found!r}")
        time.sleep(0.05)


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def kind_named(name: str) -> Kind:
    return next(kind for kind in CHILD_KINDS if kind.kind == name)


class Place:
    """One namespace of a control plane, seen as the administrator."""

    def __init__(self, plane: ControlPlane, namespace: str) -> None:
        self.plane = plane
        self.namespace = namespace

    def create(self, kind: Kind, manifest: Manifest) -> Manifest:
        return self._send("POST", kind.path(self.namespace), manifest)

    def get(self, kind: Kind, name: str) -> Manifest | None:
        try:
            return self._send("GET", kind.path(self.namespace, name))
        except urllib.error.HTTPError as error:
            with error:
                if error.code == 404:
                    return None
                raise

    def there(self, kind: Kind, name: str) -> Manifest:
        """The object, as soon as it is there."""
        return eventually(lambda: self.get(kind, name), f"{kind.kind} {name}")

    def gone(self, kind: Kind, name: str) -> None:
        eventually(lambda: self.get(kind, name) is None, f"{kind.kind} {name} to be gone")

    def list(self, kind: Kind) -> list[Manifest]:
        return list(self._send("GET", kind.path(self.namespace))["items"])

    def patch(self, kind: Kind, name: str, patch: Mapping[str, Any], subresource: str = "") -> Manifest:
        path = kind.path(self.namespace, name, subresource) + "?fieldManager=somebody"
        return self._send("PATCH", path, patch, "application/merge-patch+json")

    def delete(self, kind: Kind, name: str) -> None:
        self._send("DELETE", kind.path(self.namespace, name))

    def roff(self, name: str = "walker") -> Manifest:
        found = self.get(ROBOT_OFFLOAD, name)
        assert found is not None
        return found

    def change(self, spec: Mapping[str, Any], name: str = "walker") -> Manifest:
        return self.patch(ROBOT_OFFLOAD, name, {"spec": spec})

    def replace_spec(self, spec: Manifest, name: str = "walker") -> None:
        """The whole specification, as `kubectl replace` does it; defaults fill what is left out."""

        def replaced() -> bool:
            try:
                self._send("PUT", ROBOT_OFFLOAD.path(self.namespace, name), {**self.roff(name), "spec": spec})
            except urllib.error.HTTPError as error:
                with error:
                    if error.code != 409:  # the status was written meanwhile
                        raise AssertionError(error.read().decode()) from error
                return False
            return True

        eventually(replaced, "the new specification to be taken")

    def authorities(self, uid: str = "", home: str = HOME) -> dict[str, Manifest]:
        """The Secrets of the authorities of the walker (or of another uid) in the operator's namespace, by role."""
        names = secret_names(uid or self.roff()["metadata"]["uid"])
        found = {role: Place(self.plane, home).get(SECRET, name) for role, name in names.items()}
        return {role: secret for role, secret in found.items() if secret is not None}

    def replicas(self, deployment: str) -> int:
        return int(self.there(DEPLOYMENT, deployment)["spec"]["replicas"])

    def renew(
        self,
        site: str,
        reason: str,
        name: str = "walker",
        certificate: Mapping[str, str] | None = None,
        audit: str = "",
    ) -> None:
        """Write the robot's Lease as the reporter does."""
        generation = self.roff(name)["metadata"]["generation"]
        settings = {"robot_generation": generation, "accepted": True, "reason": "", "message": ""}
        state = {
            "version": 1, "agent_generation": generation, "connected": True, "site": site, "epoch": 3,
            "reason": reason, "message": "as a test says", "ready": True, "settings": settings,
            "certificate": dict(certificate or {}), "audit": audit,
        }  # fmt: skip
        spec = {"holderIdentity": name, "leaseDurationSeconds": 30, "renewTime": f"{_now():%Y-%m-%dT%H:%M:%S.%fZ}"}
        annotations = {"robotoffload.dev/state": json.dumps(state)}
        self.patch(LEASE, f"{name}-robot", {"metadata": {"annotations": annotations}, "spec": spec})

    def condition(self, type_: str, name: str = "walker") -> Manifest:
        """A condition of the present generation; empty while there is none."""
        roff = self.roff(name)
        for condition in (roff.get("status") or {}).get("conditions", ()):
            if condition["type"] == type_ and condition["observedGeneration"] == roff["metadata"]["generation"]:
                return dict(condition)
        return {}

    def wait_condition(self, type_: str, status: str, reason: str = "", name: str = "walker") -> Manifest:
        def look() -> Manifest | None:
            found = self.condition(type_, name)
            fits = found.get("status") == status and reason in ("", found.get("reason"))
            return found if fits else None

        return eventually(look, f"{type_}={status} {reason} of {name}", lambda: self.roff(name).get("status"))

    def applied(self, name: str = "walker") -> Manifest:
        """Wait until the operator has applied the present generation; returns the RobotOffload."""
        self.wait_condition("ResourcesApplied", "True", name=name)
        return self.roff(name)

    def children(self, name: str = "walker") -> dict[tuple[str, str], Manifest]:
        """All objects with the labels of a RobotOffload's children, by kind and name."""
        found = {}
        for kind in CHILD_KINDS:
            path = f"{kind.path(self.namespace)}?labelSelector=app.kubernetes.io/instance={name}"
            for item in self._send("GET", path)["items"]:
                found[kind.kind, item["metadata"]["name"]] = {"kind": kind.kind, "apiVersion": kind.api_version, **item}
        return found

    def shape(self, name: str = "walker") -> dict[tuple[str, str], Manifest]:
        """The children without what differs between two equal installations (uids, times, keys, addresses)."""
        children = self.children(name)
        uid = self.roff(name)["metadata"]["uid"]
        others = {self.namespace: "NAMESPACE", uid: "UID", handover.proof(uid): "PROOF"}
        for (kind, service), child in children.items():
            if kind == "Service":
                others[child["spec"]["clusterIP"]] = f"ADDRESS OF {service}"
        return {key: _plain(child, others) for key, child in children.items()}

    def written(self, name: str = "walker") -> dict[tuple[str, str], Manifest]:
        """Returns the children without what the cluster itself writes at any time: status, and the version with it."""
        changing = ("resourceVersion", "managedFields")
        return {
            key: {field: value for field, value in child.items() if field not in ("status", "metadata")}
            | {field: value for field, value in child["metadata"].items() if field not in changing}
            for key, child in self.children(name).items()
        }

    def events(self, name: str = "walker") -> list[Manifest]:
        items = self._send("GET", f"/api/v1/namespaces/{self.namespace}/events")["items"]
        return [item for item in items if item["involvedObject"].get("name") == name]

    def _send(self, verb: str, path: str, body: Any = None, content_type: str = "application/json") -> Manifest:
        answer: Manifest = json.loads(self.plane.request(verb, path, body, content_type))
        return answer


_OF_ONE_OBJECT = (
    "uid",
    "resourceVersion",
    "creationTimestamp",
    "generation",
    "managedFields",
    "selfLink",
    "clusterIP",
    "clusterIPs",
    "nodePort",
    "healthCheckNodePort",
    "robotoffload.dev/applied",
    "robotoffload.dev/config-hash",  # of the agent: it reads a certificate, whose key is random
    "deployment.kubernetes.io/revision",
)


def _plain(child: Manifest, others: Mapping[str, str]) -> Manifest:
    plain = {key: value for key, value in child.items() if key != "status"}
    if child["kind"] == "Secret":
        plain["data"] = sorted(child["data"])
    text = json.dumps(plain, sort_keys=True)
    for value, name in others.items():
        text = re.sub(rf"(?<![\w.]){re.escape(value)}(?![\w.]|\d)", name, text)
    text = re.sub(r"\bgeneration: \d+", "generation: N", text)  # in the agents' files; it grows with every change
    text = re.sub(r"changed_by: [^\\]+", "changed_by: SOMEBODY", text)  # there too, with the time
    return dict(json.loads(text, object_hook=_without))


def _without(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key not in _OF_ONE_OBJECT}
