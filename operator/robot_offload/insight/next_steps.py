"""The meaning of each reason of a condition and what to do: the one table behind `explain` and the docs.

`{name}` and `{namespace}` are those of the RobotOffload. docs/how-to/troubleshooting.md carries the same rows; a
contract test holds both against the reasons in `reconcile`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

PODS: Final = "kubectl get pods -n {namespace} -l app.kubernetes.io/instance={name}"
AGENT_LOG: Final = "kubectl logs -n {namespace} deployment/{name}-agent -c agent"
BUNDLE: Final = "kubectl offload bundle {name} -n {namespace} -o DIR, then copy the folder to the robot"
OPERATOR_LOG: Final = "kubectl logs -n robot-offload-system deployment/robot-offload-operator"


@dataclass(frozen=True, slots=True)
class Advice:
    """What a reason means, and the next step.

    Attributes:
        meaning: one sentence.
        step: what to do, a command if there is one; empty: nothing.
    """

    meaning: str
    step: str = ""

    def at(self, namespace: str, name: str) -> str:
        """Return the step for one RobotOffload."""
        return self.step.replace("{name}", name).replace("{namespace}", namespace)


GOOD: Final[dict[str, Advice]] = {
    "Valid": Advice("The specification can be carried out."),
    "ValidWithWarnings": Advice(
        "The specification can be carried out, and something in it is probably not meant.",
        "Read the message; kubectl offload validate --cluster FILE says the same before you apply.",
    ),
    "Applied": Advice("Every object in the cluster is as it should be."),
    "AppliedWithAdditions": Advice(
        "Every field of ours is as it should be; others have added containers, variables, files or ports.",
        "Read the message; kubectl get it with -o yaml --show-managed-fields names who has added it.",
    ),
    "Available": Advice("All pods that are wanted are ready."),
    "NotNeeded": Advice("This RobotOffload does without."),
    "Degraded": Advice(
        "At least one discovery server is ready, so nodes find each other; another one is missing.", PODS
    ),
    "ScaledDown": Advice("The workload has no pods, on purpose."),
    "Built": Advice("The images of all nodes with a build block are in the registry."),
    "Connected": Advice("The robot's agent is connected."),
    "Current": Advice("The robot runs the settings of the present generation."),
    "Known": Advice("The cluster has given every address that the robot needs."),
    "Issued": Advice("Certificates of cloud and robot are there and valid."),
    "IssuedByIssuer": Advice("Your own issuer has delivered the certificates and renews them."),
    "Wanted": Advice("The nodes in the cloud should have pods."),
    "Ready": Advice("The cloud can act for the robot."),
}
"""Reasons of conditions that are true."""

WORKLOADS: Final[dict[str, Advice]] = {
    "PodsNotReady": Advice("Pods are starting, or do not become ready.", PODS),
    "Unschedulable": Advice(
        "No node of the cluster fits a pod: not enough CPU, memory or GPU, or nodeSelector and tolerations fit none.",
        "Lower spec.nodes[].resources, correct nodeSelector and tolerations, or add a node; kubectl describe nodes "
        "shows what is free.",
    ),
    "ImagePullFailing": Advice(
        "An image cannot be pulled: its name is wrong, it does not exist, or the registry wants a login.",
        "Correct spec.nodes[].image, or name a login in spec.cloud.imagePullSecrets; kubectl describe pod -n "
        "{namespace} -l app.kubernetes.io/instance={name} shows the registry's answer.",
    ),
    "CrashLoop": Advice(
        "A container ends again and again.",
        "kubectl logs -n {namespace} deployment/WORKLOAD --previous (the message names the workload).",
    ),
    "CreateContainerConfigError": Advice(
        "A container cannot be started: mostly a ConfigMap or Secret that it names is missing.",
        "Create what the message names; spec.nodes[].run.parametersFrom refers to ConfigMaps in namespace {namespace}.",
    ),
    "CreateContainerError": Advice("The container runtime refuses a container.", PODS),
    "RunContainerError": Advice(
        "A container was made and cannot run: mostly the command does not exist in the image.",
        "Correct spec.nodes[].run or the image.",
    ),
    "PodsRefused": Advice(
        "The API server refuses pods: a quota, a limit range, pod security or a policy forbids them.",
        "kubectl describe quota -n {namespace}; kubectl get namespace {namespace} --show-labels",
    ),
    "NotMade": Advice("The objects are being made.", "Wait some seconds; then look at the operator: " + OPERATOR_LOG),
    "Missing": Advice("Something that should exist does not yet.", "Wait some seconds; then: " + OPERATOR_LOG),
}
"""Reasons of WorkloadsAvailable and DiscoveryReady."""

BUILDS: Final[dict[str, Advice]] = {
    "Building": Advice(
        "An image is being built; its node runs the image that it had, or waits for its first one.",
        "Wait; kubectl get jobs -n {namespace} -l app.kubernetes.io/instance={name} shows the Job.",
    ),
    "BuildFailed": Advice(
        "An image could not be built; its node keeps the image that it had. It is tried again after an hour.",
        "Read the lines in the message; correct the source or spec.nodes[].build. To try again at once: kubectl delete "
        "job -n {namespace} -l app.kubernetes.io/instance={name}",
    ),
    "SecretMissing": Advice(
        "A Secret that a build needs is not there.",
        "Create what the message names in namespace {namespace}, e.g. with kubectl create secret docker-registry.",
    ),
    "SecretType": Advice(
        "A Secret that a build names is of another type than its purpose asks for; nothing of it is read.",
        "Make one of the type that the message names, e.g. with kubectl create secret generic --type=...",
    ),
    "BuildsDisabled": Advice(
        "The administrator has not allowed this cluster to build images.",
        "Build it elsewhere (robot-offload build) and name it in spec.nodes[].image; or ask for the chart value "
        "builds.enabled=true.",
    ),
}
"""Reasons of ImageBuilt."""

ROBOT: Final[dict[str, Advice]] = {
    "NeverConnected": Advice("No robot has ever connected.", BUNDLE),
    "Disconnected": Advice(
        "The robot's agent has gone; the robot acts alone.",
        "On the robot: journalctl -u robot-offload-agent, and robot-offload doctor for ports and limits.",
    ),
    "LeaseExpired": Advice("The cloud agent has stopped reporting; the robot's state is not known.", AGENT_LOG),
    "NotConnected": Advice("The robot is not connected, so only it knows.", "See condition Connected."),
    "Unreadable": Advice(
        "The robot gave a reason that is not a single word, so it is not shown.",
        "Look at the agent's log on the robot: journalctl -u robot-offload-agent",
    ),
    "NotReported": Advice("The agents have not said yet.", "Wait some seconds; then: " + AGENT_LOG),
    "Pending": Advice("The settings are on their way to the robot.", "Wait some seconds."),
    "Refused": Advice(
        "The robot refuses the new settings and keeps its old ones.",
        "Correct what the message names: settings may never be looser than the limits of the robot's own bundle.",
    ),
    "NeedsBundle": Advice(
        "Something changed that the robot reads only at its start.", BUNDLE + " and restart its agent."
    ),
    "BundleOutdated": Advice(
        "The cloud's address has changed: none of those in the robot's bundle leads to it any more.",
        BUNDLE + " and restart its agent; with spec.transport.expose.host it dials a name, which stays.",
    ),
    "SwitchedOff": Advice(
        "spec.replicas is 0: the cloud side is switched off.",
        "kubectl scale roff/{name} -n {namespace} --replicas=1 switches it on.",
    ),
    "RobotGone": Advice("The robot was gone for spec.scale.idleTimeout; its nodes wait without pods.", BUNDLE),
    "AgentSilent": Advice("The cloud agent's process has stopped.", AGENT_LOG),
}
"""Reasons around the robot: Connected, ConfigCurrent, placement."""

CERTIFICATES: Final[dict[str, Advice]] = {
    "CertificatesPending": Advice("The operator has not made the certificates of cloud and robot yet.", OPERATOR_LOG),
    "WaitingForIssuer": Advice(
        "cert-manager has not delivered the certificates yet.",
        "kubectl describe certificate -n {namespace} -l app.kubernetes.io/instance={name}",
    ),
    "Expiring": Advice("A certificate ends soon and is made anew.", BUNDLE),
    "Expired": Advice("The robot's certificate has ended; it cannot connect.", BUNDLE),
    "AlreadyRenewed": Advice(
        "The robot's certificate was renewed with another key: a copy is in use, or the robot has lost its state.",
        "kubectl offload revoke {name} -n {namespace} when in doubt; then " + BUNDLE,
    ),
    "NoProof": Advice(
        "A certificate is requested without the robot's key.",
        "See who may write Leases in {namespace}: kubectl auth can-i patch leases -n {namespace} --as USER",
    ),
    "RequestUnreadable": Advice(
        "The robot's request for a certificate cannot be read.", "Install the same release of the agent on both sides."
    ),
    "Used": Advice("The robot has made a key of its own with the bundle's; the next bundle holds another one.", ""),
    "TooEarly": Advice(
        "The robot asks for a certificate in the first half of the life of the one that it has.",
        "Check the robot's clock.",
    ),
    "TooMany": Advice(
        "The robot's certificate was renewed too often of late.", "kubectl offload revoke {name} -n {namespace}"
    ),
    "OwnIssuer": Advice("Your own issuer signs for keys made in the cluster, not for the robot's.", BUNDLE),
    "RenewalFailed": Advice(
        "The robot cannot make or keep a key of its own.",
        "The message says why: mostly the program openssl is missing on the robot, or its disk is full.",
    ),
    "Revoked": Advice("The robot was revoked; a new client authority was made.", BUNDLE),
    "OtherAuthority": Advice("A certificate was signed by another authority and is made anew.", BUNDLE),
    "OtherHosts": Advice("The declared host has changed; the cloud's certificate is made anew.", BUNDLE),
    "OtherRobot": Advice("The certificate names another robot and is made anew.", BUNDLE),
}
"""Reasons of CertificatesReady and CertificateCurrent, and of the events about a new certificate."""

CLUSTER: Final[dict[str, Advice]] = {
    "AddressPending": Advice(
        "The cluster has not given the Services an address yet.",
        "kubectl get services -n {namespace} -l app.kubernetes.io/instance={name}; without a load balancer write "
        "spec.transport.expose.type: NodePort.",
    ),
    "AddressFamily": Advice(
        "The cloud has IPv6 addresses only, and agents, routers and discovery servers listen on IPv4.",
        "kubectl get services -n {namespace} -l app.kubernetes.io/instance={name} -o wide; see the message.",
    ),
    "NotAdmitted": Advice(
        "It may have been written while no admission policy asked its writer for rights, so it does not act.",
        "Whoever has the rights to what it names runs the command in the message.",
    ),
    "NameTaken": Advice(
        "An object with the name of one of ours exists and has another owner; it is left alone.",
        "The message names it: delete or rename it, or give the RobotOffload another name.",
    ),
    "Contested": Advice(
        "Another controller sets fields of an object of ours again and again; the operator takes them "
        "back ever less often.",
        "The message names the field manager: stop it from writing that object, e.g. in the settings of "
        "your GitOps tool.",
    ),
    "CannotRender": Advice(
        "The specification passed its checks, and no objects can be made of it.",
        "Correct what the message names; what runs in the cluster stays as it is until then.",
    ),
    "OperatorBug": Advice(
        "A step of the operator broke; what runs in the cluster stays as it is.",
        "Report the message together with the object; the traceback is in kubectl logs -n "
        "robot-offload-system deployment/robot-offload-operator",
    ),
    "WaitingForTurn": Advice(
        "A new version of the operator wants other pods; those of this RobotOffload are replaced when others are done.",
        "Wait; MAX_ROLLING of the operator says how many are replaced at once.",
    ),
    "WaitingForDeletion": Advice(
        "An object of ours is being deleted; it is made again when it is gone.",
        "Wait; if it stays, kubectl get it with -o yaml and look at its finalizers.",
    ),
    "Conflict": Advice(
        "An object, or a field of one, that is needed has another owner.",
        "The message names it; rename or delete the other object, or stop what changes it.",
    ),
    "AlreadyExists": Advice("An object of this name has another owner.", "Rename it, or rename {name}."),
    "Forbidden": Advice("The operator's role does not allow something.", "helm upgrade the chart: its role fits it."),
    "Invalid": Advice(
        "The API server does not accept an object.",
        "The message says which field: correct it in spec. The same refusal is tried again only when "
        "something changes.",
    ),
    "NotFound": Advice("A kind or a namespace is missing.", "Install the custom resource definition: helm upgrade."),
    "TooManyRequests": Advice("The API server asks to slow down.", "Wait; the operator tries again by itself."),
    "ServerFailed": Advice("The API server has a problem of its own.", "Wait; the operator tries again by itself."),
    "Unreachable": Advice("The API server does not answer.", "Wait; the operator tries again by itself."),
    "Unauthorized": Advice("The API server does not accept the operator's token.", "Restart the operator's pod."),
    "ApiServerRefused": Advice("The API server refused a request.", OPERATOR_LOG),
    "NotConfigured": Advice("It is not known which cluster to talk to.", "Set KUBECONFIG, or pass --kubeconfig."),
}
"""Reasons of ResourcesApplied."""

OWN: Final[dict[str, Advice]] = {
    "NoStatus": Advice(
        "The operator has not looked at this object yet: it is not running, or watches another namespace.",
        "kubectl get deployments -A -l app.kubernetes.io/name=robot-offload-operator; none: helm install it.",
    ),
    "InProgress": Advice(
        "The operator has not dealt with the last change yet.", "Wait some seconds; then: " + OPERATOR_LOG
    ),
    "BeingDeleted": Advice("The object is being deleted.", "Wait; everything that it made goes with it."),
}
"""Reasons that the command line itself finds."""

NEXT_STEPS: Final[dict[str, Advice]] = GOOD | WORKLOADS | BUILDS | ROBOT | CERTIFICATES | CLUSTER | OWN

INVALID: Final = Advice(
    "The specification cannot be carried out; what was made before stays as it is.",
    "Correct every line of the message and apply again; kubectl offload validate --cluster FILE checks it before.",
)
"""For SpecValid=False, which has the reason of the first problem."""


def asks_for_bundle(step: str) -> bool:
    """Return whether a step begins with writing a bundle."""
    return "kubectl offload bundle" in step


def advice(condition: str, reason: str) -> Advice:
    """Return the advice for a reason of a condition."""
    if reason in NEXT_STEPS:
        return NEXT_STEPS[reason]
    if condition == "SpecValid":
        return INVALID
    return Advice("", "The message says more; the operator's log says most: " + OPERATOR_LOG)
