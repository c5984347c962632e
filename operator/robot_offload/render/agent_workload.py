"""The cloud agent: its Deployment with the reporter beside it, their rights and configuration."""

from __future__ import annotations

from typing import Any, Final

from robot_offload import transport
from robot_offload.kube.kinds import CONFIG_MAP, LEASE, ROLE, ROLE_BINDING, SERVICE, SERVICE_ACCOUNT, Kind
from robot_offload.kube.port import Manifest
from robot_offload.objects import names, pod
from robot_offload.objects.hashes import config_hash
from robot_offload.objects.names import child_name
from robot_offload.objects.parent import Parent, Part
from robot_offload.render import dds_profile, handover
from robot_offload.render.agent_config import (
    AgentSite,
    agent_parameters,
    parameter_file,
    runtime_parameters,
    start_parameters,
)

CONFIG_DIR: Final = "/etc/robot-offload/agent"
SETTINGS_DIR: Final = "/etc/robot-offload/settings"
RUNTIME_DIR: Final = "/run/robot-offload"
STATE_DIR: Final = "/var/lib/robot-offload"
CONFIG_KEY: Final = "agent.yaml"
SETTINGS_KEY: Final = "settings.yaml"
STATE_FILE: Final = f"{RUNTIME_DIR}/state.json"
HANDOVER_FILE: Final = f"{RUNTIME_DIR}/handover"
SETTINGS_FILE: Final = f"{RUNTIME_DIR}/{SETTINGS_KEY}"
"""Written by the reporter, which watches the ConfigMap: a kubelet may take over a minute to bring a change."""
ANSWER_KEY: Final = "certificate.json"
ANSWER_FILE: Final = f"{RUNTIME_DIR}/{ANSWER_KEY}"
"""Written by the reporter from the same ConfigMap: the answer to the robot's request for a certificate."""
LEASE_DURATION_S: Final = 30
"""Three times the reporter's period: one lost write does not mean a lost robot."""
_TOKEN_DIR: Final = "/var/run/secrets/kubernetes.io/serviceaccount"  # noqa: S105 - a folder, not a secret
_TOKEN_LIFE_S: Final = 3607


def agent_objects(parent: Parent) -> tuple[Manifest, ...]:
    """Return all objects of the cloud agent except its Deployment, in the order in which they are applied."""
    offered = runtime_parameters(parent.offload, parent.facts.generation)
    settings = {SETTINGS_KEY: parameter_file(offered, parent.facts.author)}
    if parent.facts.certificate_answer:
        settings[ANSWER_KEY] = parent.facts.certificate_answer
    return (
        *_rights(parent),
        _lease(parent),
        _service(parent),
        parent.config_map(_part(parent), {CONFIG_KEY: parameter_file(agent_parameters(parent.offload, site(parent)))}),
        parent.config_map(Part(child_name(parent.name, names.SETTINGS), "settings"), settings),
    )


def agent_deployment(parent: Parent) -> Manifest:
    """Return the Deployment. It is never scaled to zero: it must hear the robot return."""
    name = _part(parent).name
    volumes = [
        pod.config_map_volume("configuration", name, [CONFIG_KEY]),
        pod.config_map_volume("settings", child_name(parent.name, names.SETTINGS), [SETTINGS_KEY]),
        # In memory, because the state is written every second.
        {"name": "runtime", "emptyDir": {"medium": "Memory", "sizeLimit": "16Mi"}},
        {"name": "state", "emptyDir": {}},
        _token_volume(),
        *dds_profile.volumes(parent.offload),
    ]
    if transport.of(parent.spec).traits.agent_needs_certificates:
        volumes.append(pod.certificates_volume(child_name(parent.name, names.CLOUD)))
    template = pod.pod_template(
        parent,
        _part(parent),
        [_agent(parent), _reporter(parent)],
        read=config_hash(read_at_start(parent)),
        grace_s=handover.GRACE_S,
        volumes=volumes,
        extra={"serviceAccountName": name},
    )
    return pod.deployment(parent, _part(parent), template)


def site(parent: Parent) -> AgentSite:
    """Return the cloud agent's site."""
    return AgentSite(
        side="cloud",
        host="0.0.0.0",  # noqa: S104 - the pod's only interface; the network policy restricts access
        ca=f"{pod.CERTIFICATES_DIR}/ca.crt",
        certificate=f"{pod.CERTIFICATES_DIR}/tls.crt",
        private_key=f"{pod.CERTIFICATES_DIR}/tls.key",
        pulse_port=transport.PULSE_PORT,
        data_port=transport.DATA_PORT,
        peer_name=parent.certificate_name("robot"),
        uid=parent.identity,
        runtime_dir=RUNTIME_DIR,
        state_dir=STATE_DIR,
        generation=parent.facts.generation,
        state_file=STATE_FILE,
        settings_file=SETTINGS_FILE,
        certificate_file=ANSWER_FILE if transport.needs_certificates(parent.spec) else "",
        handover_file=HANDOVER_FILE,
    )


def read_at_start(parent: Parent) -> Any:
    """Return what the agent's processes read once, at their start: all that settings cannot change later."""
    certificates = parent.facts.certificate_hash if transport.of(parent.spec).traits.agent_needs_certificates else ""
    return [start_parameters(agent_parameters(parent.offload, site(parent))), certificates]


def _part(parent: Parent) -> Part:
    return Part(child_name(parent.name, names.AGENT), "agent")


def _agent(parent: Parent) -> Manifest:
    chosen = transport.of(parent.spec)
    mounts = [
        pod.mount("configuration", CONFIG_DIR),
        pod.mount("runtime", RUNTIME_DIR, read_only=False),
        pod.mount("state", STATE_DIR, read_only=False),
        *dds_profile.mounts(parent.offload),
    ]
    if chosen.traits.agent_needs_certificates:
        mounts.append(pod.mount("certificates", pod.CERTIFICATES_DIR))
    extra: Manifest = {"lifecycle": handover.pre_stop()}
    ports = transport.agent_ports(parent.offload)
    if ports:
        extra["ports"] = [
            {"name": port.name, "containerPort": port.number, "protocol": port.protocol} for port in ports
        ]
    return pod.container(
        "agent",
        parent.agent_image,
        ["robot-offload-agent", "cloud", "--params", f"{CONFIG_DIR}/{CONFIG_KEY}"],
        environment={
            **pod.ros_environment(parent.offload),
            **chosen.node_environment(parent),
            **dds_profile.environment(parent.offload),
            # It must see the whole graph, not only its own peers.
            **({"ROS_SUPER_CLIENT": "TRUE"} if transport.discovery_servers(parent.spec) else {}),
            handover.URL_VARIABLE: handover.url("127.0.0.1", parent.uid),
        },
        mounts=mounts,
        # No CPU limit: throttling takes longer than the loss timeout.
        resources={"requests": {"cpu": "200m", "memory": "160Mi"}, "limits": {"memory": "768Mi"}},
        extra=extra,
    )


def _reporter(parent: Parent) -> Manifest:
    def probe(path: str, period_s: int, failures: int) -> Manifest:
        return {
            "httpGet": {"path": path, "port": "http"},
            "periodSeconds": period_s,
            "timeoutSeconds": 2,
            "failureThreshold": failures,
        }

    return pod.container(
        "reporter",
        parent.facts.images.operator,
        ["python", "-m", "robot_offload.reporter"],
        environment={
            "NAMESPACE": parent.namespace,
            "ROBOT_NAME": parent.name,
            "LEASE_NAME": child_name(parent.name, names.ROBOT),
            "STATE_FILE": STATE_FILE,
            "HANDOVER_FILE": HANDOVER_FILE,
            handover.PROOF_VARIABLE: handover.proof(parent.uid),
            "SETTINGS_NAME": child_name(parent.name, names.SETTINGS),
            "SETTINGS_MOUNTED": f"{SETTINGS_DIR}/{SETTINGS_KEY}",
            "SETTINGS_FILE": SETTINGS_FILE,
            "ANSWER_FILE": ANSWER_FILE,
            "HOME": pod.TMP,
            handover.URL_VARIABLE: handover.url("127.0.0.1", parent.uid),
        },
        mounts=[
            pod.mount("runtime", RUNTIME_DIR, read_only=False),
            pod.mount("settings", SETTINGS_DIR),
            pod.mount("token", _TOKEN_DIR),
        ],
        resources={"requests": {"cpu": "10m", "memory": "96Mi"}, "limits": {"memory": "192Mi"}},
        extra={
            "ports": [{"name": "http", "containerPort": handover.PORT, "protocol": "TCP"}],
            "readinessProbe": probe("/readyz", 2, 3),
            "livenessProbe": probe("/healthz", 10, 3),
            # It must outlive the handover for which the agent's container waits.
            "lifecycle": handover.pre_stop(),
        },
    )


def _rights(parent: Parent) -> tuple[Manifest, ...]:
    """Return the reporter's rights: read and change one Lease, read one ConfigMap, and nothing else."""
    part = _part(parent)
    rules = [
        _rule(LEASE, child_name(parent.name, names.ROBOT), "get", "patch"),
        _rule(CONFIG_MAP, child_name(parent.name, names.SETTINGS), "get", "watch"),
    ]
    binding = {
        "roleRef": {"apiGroup": ROLE.group, "kind": ROLE.kind, "name": part.name},
        "subjects": [{"kind": SERVICE_ACCOUNT.kind, "name": part.name, "namespace": parent.namespace}],
    }
    return (
        parent.child(SERVICE_ACCOUNT, part, {"automountServiceAccountToken": False}),
        parent.child(ROLE, part, {"rules": rules}),
        parent.child(ROLE_BINDING, part, binding),
    )


def _rule(kind: Kind, name: str, *verbs: str) -> Manifest:
    """Return a rule for one object."""
    return {"apiGroups": [kind.group], "resources": [kind.plural], "resourceNames": [name], "verbs": list(verbs)}


def _lease(parent: Parent) -> Manifest:
    """Return the robot's Lease, without holder and times, which the reporter sets."""
    name = child_name(parent.name, names.ROBOT)
    body = {"spec": {"leaseDurationSeconds": LEASE_DURATION_S}}
    return parent.child(LEASE, Part(name, "agent"), body)


def _service(parent: Parent) -> Manifest:
    port = {"name": "http", "port": handover.PORT, "targetPort": "http", "protocol": "TCP"}
    body = {"spec": {"type": "ClusterIP", "selector": parent.selector(_part(parent)), "ports": [port]}}
    return parent.child(SERVICE, _part(parent), body)


def _token_volume() -> Manifest:
    """Return the volume that Kubernetes would mount into every container, here for the reporter alone."""
    sources = [
        {"serviceAccountToken": {"path": "token", "expirationSeconds": _TOKEN_LIFE_S}},
        {"configMap": {"name": "kube-root-ca.crt", "items": [{"key": "ca.crt", "path": "ca.crt"}]}},
        {
            "downwardAPI": {
                "items": [{"path": "namespace", "fieldRef": {"apiVersion": "v1", "fieldPath": "metadata.namespace"}}]
            }
        },
    ]
    return {"name": "token", "projected": {"sources": sources, "defaultMode": 0o444}}
