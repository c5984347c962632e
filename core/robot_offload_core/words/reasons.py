"""Why something was decided, as types: what a reason implies is its property, and its text is never compared.

People and machines read the word of a member (log, `/offload/placement`, diagnostics, the robot's Lease); it never
changes. `docs/reference/reasons.md` is generated from the enumerations that build on `Explained`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from robot_offload_core.fence.token import Site


class Explained(str, Enum):
    """A word with its cause and the next step for a person who reads it.

    Attributes:
        cause: what has happened, one sentence without its full stop.
        advice: the next step; "" if nothing need be done.
    """

    _value_: str
    cause: str
    advice: str

    def __new__(cls, word: str, cause: str, advice: str = "") -> Explained:
        """Make the member with the value `word`."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.cause, member.advice = cause, advice
        return member

    def __str__(self) -> str:
        """Return the word itself."""
        return self._value_

    __hash__ = str.__hash__  # a member is the key that its word is


class Kind(str, Enum):
    """The origin of a reason, from the strongest to the weakest.

    LIMIT: a hard limit is broken; it ends a stay in the cloud at once and forbids the next. VETO: the cloud is
    forbidden, even if a person asks for it. PIN: a person fixed the side. HAND: a person asked for the side. ATTEMPT: a
    changeover failed, or is not begun because the other side lacks something. NEED: the robot cannot act. POLICY: the
    rule weighs the link. PREFERENCE: the resource prefers the robot. STATE: nothing is decided yet.
    """

    LIMIT = "hard limit"
    VETO = "veto"
    PIN = "pin"
    HAND = "by hand"
    ATTEMPT = "attempt"
    NEED = "need"
    POLICY = "policy"
    PREFERENCE = "preference"
    STATE = "state"


class Reason(Explained):
    """Why a side is (to be) in charge.

    Attributes:
        kind: see Kind.
    """

    kind: Kind

    def __new__(cls, word: str, kind: Kind, cause: str, advice: str = "") -> Reason:
        """Make the member with the value `word`."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.kind, member.cause, member.advice = kind, cause, advice
        return member

    @property
    def urgent(self) -> bool:
        """Return whether dwell, hold-down and retry delays are skipped: for a veto, a pin or a switch by hand."""
        return self.kind in (Kind.VETO, Kind.PIN, Kind.HAND)

    @property
    def chosen(self) -> bool:
        """Return whether the side was chosen explicitly; that is shown even while a limit forbids the other side."""
        return self.urgent or self.kind is Kind.PREFERENCE

    @property
    def yields_to_need(self) -> bool:
        """Return whether this demand for the robot is dropped if the robot cannot act and the cloud can."""
        return self.kind is not Kind.PIN and (self.kind is not Kind.VETO or self in _YIELDING_VETOES)

    @property
    def forbids(self) -> bool:
        """Return whether this reason, if found by another process, forbids the cloud and ends a stay there.

        Other reasons are judged only before a stay: they stop the policy, delay a pin or a switch by hand, and are
        otherwise only reported.
        """
        return self.kind in (Kind.LIMIT, Kind.VETO)

    @property
    def hardens(self) -> bool:
        """Return whether this veto becomes a hard limit if the robot is not in charge by the activation deadline.

        While such a veto holds, consumers may hear two producers, so goals and nodes get no more time.
        """
        return self in _HARDENING_VETOES

    STARTING = "Starting", Kind.STATE, "The control process has just started", "Wait for the first beat of the cloud"

    # hard limits: pulse
    CONTROL_STALLED = (
        "ControlStalled", Kind.LIMIT, "The robot's own control process stood still for longer than a lease",
        "Give the agent CPU time: real-time priority, no fractional CPU limit",
    )  # fmt: skip
    CONTROL_STARVED = (
        "ControlStarved", Kind.LIMIT, "The robot's own control process gets its CPU in slices, for longer than a lease",
        "Give the agent CPU time: real-time priority, no fractional CPU limit",
    )  # fmt: skip
    PULSE_SILENT = (
        "PulseSilent", Kind.LIMIT, "The robot's own pulse process does not send",
        "Look for its restarts in the agent's log; give the agent CPU time",
    )  # fmt: skip
    NEVER_HEARD = (
        "NeverHeard", Kind.LIMIT, "The cloud has not been heard since the agent started",
        "Run `robot-offload doctor`: addresses, ports, certificates; is the cloud's pod running?",
    )  # fmt: skip
    HEARTBEAT_LOST = (
        "HeartbeatLost", Kind.LIMIT, "No beat of the cloud for `lossTimeout`",
        "Look at the link; a link with longer gaps needs a longer `lossTimeout` and `lease`",
    )  # fmt: skip
    CLOUD_CONTROL_SILENT = (
        "CloudControlSilent", Kind.LIMIT, "The cloud's control process does not renew its report",
        "Give the cloud's agent CPU time: no fractional CPU limit",
    )  # fmt: skip
    ECHO_STALE = (
        "EchoStale", Kind.LIMIT, "The cloud is heard but has not heard the robot in time: one direction is cut",
        "Look at the uplink",
    )  # fmt: skip

    # hard limits: identity
    DUPLICATE_IDENTITY = (
        "DuplicateIdentity", Kind.LIMIT, "Another robot with this identity is being served",
        "Give each robot its own bundle",
    )  # fmt: skip
    NOT_SERVED = (
        "NotServed", Kind.LIMIT, "The cloud does not serve this robot (yet)",
        "Wait a second; when it stays, look at the cloud agent's log",
    )  # fmt: skip
    CLOUD_RESTARTED = (
        "CloudRestarted", Kind.LIMIT, "Another incarnation of the cloud agent answers",
        "Look why its pod was restarted: `kubectl describe pod`",
    )  # fmt: skip

    # hard limits: data
    DATA_PROCESS_SILENT = (
        "DataProcessSilent", Kind.LIMIT, "The robot's own data process does not report",
        "Look for its restarts in the agent's log; give the agent CPU time",
    )  # fmt: skip
    DATA_DISCONNECTED = (
        "DataDisconnected", Kind.LIMIT, "The data session is not connected", "Look at the data port and its Service"
    )  # fmt: skip
    DATA_SILENT = (
        "DataSilent", Kind.LIMIT, "Nothing arrives on the data session for 0.5 s", "Look at the link's throughput"
    )  # fmt: skip
    DATA_MISMATCH = (
        "DataMismatch", Kind.LIMIT, "Pulse and data sessions end at different cloud agents",
        "See that one ready agent stands behind both Services",
    )  # fmt: skip
    DATA_UNHEARD = (
        "DataUnheard", Kind.LIMIT, "The cloud hears nothing on the data session", "Look at the uplink's throughput"
    )  # fmt: skip
    CONFIGURATION_DIFFERS = (
        "ConfigurationDiffers", Kind.LIMIT,
        "Robot and cloud have other required inputs or outputs, or the same ones in another order",
        "Make a new bundle for the robot",
    )  # fmt: skip
    INPUTS_DIFFER = (
        "InputsDiffer", Kind.LIMIT, "Robot and cloud are configured with different inputs",
        "Make a new bundle for the robot",
    )  # fmt: skip
    INPUT_STALE = (
        "InputStale", Kind.LIMIT, "A required input is older in the cloud than its `maxAge`",
        "See that its publisher runs; look at the uplink's throughput",
    )  # fmt: skip

    # hard limits: the cloud's and the robot's parts
    CLOUD_NODES_DOWN = (
        "CloudNodesDown", Kind.LIMIT, "CORE nodes of the cloud are not Active", "Look at the nodes' logs in the cloud"
    )  # fmt: skip
    CLOUD_NOT_ACTING = (
        "CloudNotActing", Kind.LIMIT, "The cloud is heard but does not act under the current epoch",
        "Look at the link and at the cloud agent's log",
    )  # fmt: skip
    OUTPUT_SILENT = (
        "OutputSilent", Kind.LIMIT,
        "A rated output of the cloud is silent for its `deadline`, or for one message while the robot's replica is Hot",
        "Look at the replica that publishes the output, and at the downlink's throughput",
    )  # fmt: skip
    RESULT_STALE = (
        "ResultStale", Kind.STATE, "Results of a node with placement Cloud arrive older than their `maxAge`",
        "Look at the link; or allow older results with `maxAge`",
    )  # fmt: skip
    COLLECTOR_SILENT = (
        "CollectorSilent", Kind.LIMIT, "The collector on the robot does not report",
        "Look for its restarts in the agent's log; give the agent CPU time",
    )  # fmt: skip
    COLLECTOR_FELL_BACK = (
        "CollectorFellBack", Kind.LIMIT, "The collector did not hear control for a lease and passes only the robot",
        "Give the agent CPU time: real-time priority, no fractional CPU limit",
    )  # fmt: skip

    # hard limits: found by other processes
    TYPES_DIFFER = (
        "TypesDiffer", Kind.LIMIT, "An output or input has another interface type in the cloud than on the robot",
        "Run the same version and parameters on both sides, or declare the type",
    )  # fmt: skip
    DUPLICATE_AGENT = (
        "DuplicateAgent", Kind.LIMIT, "A second agent of this identity passes messages to the same consumers",
        "End one of the two agents",
    )  # fmt: skip

    # vetoes
    SECOND_PUBLISHER = (
        "SecondPublisher", Kind.VETO, "The public topic of an output has a publisher besides the collector",
        "Remap that node's output to the private topic (see the bundle)",
    )  # fmt: skip
    TWO_REPLICAS = (
        "TwoReplicas", Kind.VETO, "Two processes of one node publish an output's private topic on the same side",
        "End all but one: a launch started twice, what a killed launch left behind, an old pod",
    )  # fmt: skip
    UNDECLARED_PUBLISHER = (
        "UndeclaredPublisher", Kind.VETO, "A duplicated node publishes a topic that no output declares (`strict`)",
        "Declare the topic under outputs, or remap it",
    )  # fmt: skip
    SECOND_LIFECYCLE_MANAGER = (
        "SecondLifecycleManager", Kind.VETO, "Another program changes the lifecycle states of the managed nodes",
        "Take the duplicated nodes out of the other lifecycle manager's list",
    )  # fmt: skip
    SECOND_SESSION = (
        "SecondSession", Kind.VETO, "Two sessions show this robot's certificate: a second agent, or a copy of the key",
        "End the second agent, or revoke the certificate",
    )  # fmt: skip
    CLOCK_OFFSET = (
        "ClockOffset", Kind.VETO, "The system clocks of the two sides differ by more than `maxClockOffset`",
        "Synchronise them (chrony, ptp)",
    )  # fmt: skip
    POD_STOPPING = (
        "PodStopping", Kind.VETO, "The cloud's pods are stopping", "Wait until they are back, or see why they go"
    )  # fmt: skip

    # people
    PINNED_TO_ROBOT = "PinnedToRobot", Kind.PIN, "Placement is pinned to the robot", "Clear the pin to end that"
    PINNED_TO_CLOUD = "PinnedToCloud", Kind.PIN, "Placement is pinned to the cloud", "Clear the pin to end that"
    BY_HAND = "ByHand", Kind.HAND, "The side was asked for by one of the four services"

    # attempts and needs
    CLOUD_NOT_READY = (
        "CloudNotReady", Kind.ATTEMPT, "The cloud's nodes or outputs did not get ready in time, the robot goes on",
        "Look at the nodes' logs in the cloud; nodes that need longer need a longer `activationDeadline`",
    )  # fmt: skip
    ROBOT_NOT_READY = (
        "RobotNotReady", Kind.ATTEMPT, "The robot's nodes or outputs did not get ready in time, the cloud goes on",
        "Look at the nodes' logs on the robot; nodes that need longer need a longer `activationDeadline`",
    )  # fmt: skip
    GOALS_PENDING = (
        "GoalsPending", Kind.ATTEMPT, "The side that gets ready did not take over the running goals in time",
        "Look at the action servers' logs there; see `prepareDeadline` and `onSwitch`",
    )  # fmt: skip
    DIVERGED = (
        "Diverged", Kind.ATTEMPT, "A call that both sides execute (`mode: Both`) failed on the side that gets ready",
        "Look at the service's log there",
    )  # fmt: skip
    STATE_STALE = (
        "StateStale", Kind.ATTEMPT, "The side that gets ready does not know the state of the acting side in time",
        "Let the node publish its state more often than `maxAge`, or raise that; look at the link",
    )  # fmt: skip
    REPLICA_PARAMETERS_DIFFER = (
        "ReplicaParametersDiffer", Kind.ATTEMPT, "A replica has other parameters than the robot's node",
        "Give both the same parameters; name those that are to differ in `cloudParameters`",
    )  # fmt: skip
    ROBOT_UNABLE = (
        "RobotUnable", Kind.NEED, "The robot cannot act, the cloud can", "Look at the robot's nodes and collector"
    )  # fmt: skip

    BOTH_SILENT = (
        "BothSilent", Kind.NEED, "A rated output is silent on the robot, and was in the cloud when that was asked",
        "Look at the nodes; an output that is silent when there is nothing to do must not have a `rate`",
    )  # fmt: skip

    # policy
    LATENCY_TOO_HIGH = (
        "LatencyTooHigh", Kind.POLICY, "The loop latency is over what the periods and `tolerance` allow",
        "Look at the link, or allow more with `tolerance`",
    )  # fmt: skip
    LINK_UNSTEADY = "LinkUnsteady", Kind.POLICY, "The link gets worse, and its outages here last", "Look at the link"
    HOLD_DOWN = "HoldDown", Kind.POLICY, "The link is back, the wait after a loss is not over", "Wait; see `holdDown`"
    PROVING = "Proving", Kind.POLICY, "The link is good, and not for long enough yet", "Wait"
    LINK_GOOD = "LinkGood", Kind.POLICY, "The link has been good for long enough"
    CLOUD_PREFERRED = "CloudPreferred", Kind.POLICY, "The link is good enough for the cloud"
    ROBOT_PREFERRED = "RobotPreferred", Kind.PREFERENCE, "The resource prefers the robot, and it is able to act"


_YIELDING_VETOES = frozenset({Reason.POD_STOPPING})
"""Vetoes for which the robot must not stand still; for all others that is better than letting the cloud act."""

_HARDENING_VETOES = frozenset(
    {
        Reason.SECOND_PUBLISHER,
        Reason.TWO_REPLICAS,
        Reason.UNDECLARED_PUBLISHER,
        Reason.SECOND_LIFECYCLE_MANAGER,
    }
)
"""Vetoes against two producers at once: "never two" outranks "never none" and "nothing lost"."""


@dataclass(frozen=True)
class Verdict:
    """A decision with its reason (for machines) and its message (for people)."""

    site: Site
    reason: Reason
    message: str


def silence(site: Site, names: tuple[str, ...]) -> str:
    """Return a sentence about the silent rated outputs of a side."""
    who = f"output{'s' * (len(names) > 1)} {', '.join(names)}" if names else "rated outputs"
    verb = "is" if len(names) == 1 else "are"
    return f"The {site.value}'s {who} {verb} silent"
