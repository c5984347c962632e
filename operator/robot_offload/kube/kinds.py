"""Every kind of object that the program uses, with its verbs.

The chart's roles are tested against `USES`: a verb missing there would fail in a cluster, one that is only there would
be an unused right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

Verb: TypeAlias = Literal["get", "list", "watch", "create", "update", "patch", "delete"]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of Kubernetes object.

    Attributes:
        api_version: `group/version`, or `v1` for the core group.
        kind: as in YAML.
        plural: as in URLs.
        namespaced: whether objects live in a namespace.
    """

    api_version: str
    kind: str
    plural: str
    namespaced: bool = True

    @property
    def group(self) -> str:
        """The API group; empty for the core group."""
        return self.api_version.rpartition("/")[0]

    def path(self, namespace: str | None, name: str = "", subresource: str = "") -> str:
        """Return the URL path of the collection, an object or its subresource; None as namespace means all of them."""
        root = f"/apis/{self.api_version}" if self.group else f"/api/{self.api_version}"
        place = f"/namespaces/{namespace}" if self.namespaced and namespace else ""
        return "".join(
            (root, place, f"/{self.plural}", f"/{name}" if name else "", f"/{subresource}" * bool(subresource))
        )


ROBOT_OFFLOAD: Final = Kind("robotoffload.dev/v1alpha1", "RobotOffload", "robotoffloads")
DEPLOYMENT: Final = Kind("apps/v1", "Deployment", "deployments")
STATEFUL_SET: Final = Kind("apps/v1", "StatefulSet", "statefulsets")
SERVICE: Final = Kind("v1", "Service", "services")
CONFIG_MAP: Final = Kind("v1", "ConfigMap", "configmaps")
SECRET: Final = Kind("v1", "Secret", "secrets")
SERVICE_ACCOUNT: Final = Kind("v1", "ServiceAccount", "serviceaccounts")
ROLE: Final = Kind("rbac.authorization.k8s.io/v1", "Role", "roles")
ROLE_BINDING: Final = Kind("rbac.authorization.k8s.io/v1", "RoleBinding", "rolebindings")
NETWORK_POLICY: Final = Kind("networking.k8s.io/v1", "NetworkPolicy", "networkpolicies")
LEASE: Final = Kind("coordination.k8s.io/v1", "Lease", "leases")
CERTIFICATE: Final = Kind("cert-manager.io/v1", "Certificate", "certificates")
JOB: Final = Kind("batch/v1", "Job", "jobs")
POD: Final = Kind("v1", "Pod", "pods")
NODE: Final = Kind("v1", "Node", "nodes", namespaced=False)
ADMISSION_POLICY: Final = Kind(
    "admissionregistration.k8s.io/v1",
    "ValidatingAdmissionPolicy",
    "validatingadmissionpolicies",
    namespaced=False,
)
ADMISSION_BINDING: Final = Kind(
    "admissionregistration.k8s.io/v1",
    "ValidatingAdmissionPolicyBinding",
    "validatingadmissionpolicybindings",
    namespaced=False,
)
EVENT: Final = Kind("v1", "Event", "events")
NAMESPACE: Final = Kind("v1", "Namespace", "namespaces", namespaced=False)
ENDPOINTS: Final = Kind("v1", "Endpoints", "endpoints")
ACCESS_REVIEW: Final = Kind(
    "authorization.k8s.io/v1", "SelfSubjectAccessReview", "selfsubjectaccessreviews", namespaced=False
)
CUSTOM_RESOURCE_DEFINITION: Final = Kind(
    "apiextensions.k8s.io/v1", "CustomResourceDefinition", "customresourcedefinitions", namespaced=False
)

CHILD_KINDS: Final = (
    SERVICE_ACCOUNT,
    ROLE,
    ROLE_BINDING,
    SECRET,
    CONFIG_MAP,
    LEASE,
    SERVICE,
    NETWORK_POLICY,
    JOB,
    STATEFUL_SET,
    DEPLOYMENT,
)
"""A RobotOffload's children in the order in which they are applied. Each is watched, and pruned if not wanted."""

_KINDS: Final = {
    (kind.api_version, kind.kind): kind
    for kind in (
        ROBOT_OFFLOAD,
        *CHILD_KINDS,
        CERTIFICATE,
        POD,
        NODE,
        ADMISSION_POLICY,
        ADMISSION_BINDING,
        EVENT,
        NAMESPACE,
        ENDPOINTS,
        ACCESS_REVIEW,
        CUSTOM_RESOURCE_DEFINITION,
    )
}


def kind_of(manifest: dict[str, object]) -> Kind:
    """Return the kind of a manifest.

    Raises:
        KeyError: the program does not know its kind.
    """
    return _KINDS[str(manifest["apiVersion"]), str(manifest["kind"])]


@dataclass(frozen=True, slots=True)
class Use:
    """The operator's use of a kind.

    Attributes:
        kind: the kind.
        verbs: as in a role.
        subresource: `status` and the like; empty for the object itself.
        reason: why it is needed, for readers of the role.
        optional: only needed if a feature is used (an issuer of cert-manager).
    """

    kind: Kind
    verbs: tuple[Verb, ...]
    subresource: str = ""
    reason: str = ""
    optional: bool = False


USES: Final[tuple[Use, ...]] = (
    Use(ROBOT_OFFLOAD, ("get", "list", "watch"), reason="what users want"),
    Use(ROBOT_OFFLOAD, ("patch",), "status", "says what became of it"),
    Use(ROBOT_OFFLOAD, ("update",), "finalizers", reason="children block its deletion; OpenShift asks for this right"),
    *(
        Use(kind, ("get", "list", "watch", "create", "patch", "delete"), reason="made, kept and pruned")
        for kind in CHILD_KINDS
    ),
    Use(POD, ("list", "watch"), reason="says why a workload is not available"),
    Use(NODE, ("list",), reason="addresses of a Service of type NodePort"),
    Use(ADMISSION_POLICY, ("get",), reason="since when writers of RobotOffloads are asked for their rights"),
    Use(ADMISSION_BINDING, ("get",), reason="the same"),
    Use(EVENT, ("create", "list"), reason="reports transitions; says why the API server refuses pods"),
    Use(
        CERTIFICATE,
        ("get", "list", "create", "patch", "delete"),
        reason="certificates of the user's own issuer",
        optional=True,
    ),
)
"""Verbs that the operator uses. `create` beside `patch`: server-side apply needs both to create an object."""
