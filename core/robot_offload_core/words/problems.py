"""Problems that a person should look at; the agents report them in `/diagnostics` besides the decisions."""

from __future__ import annotations

from robot_offload_core.words.reasons import Explained


class Problem(Explained):
    """A problem of one agent; the robot drives on unless a reason of the placement prevents it."""

    REPLICA_MISSING = (
        "ReplicaMissing", "The cloud has not seen a replica of a duplicated node for 3 s",
        "Look at the replica's pod; without it the cloud is not chosen",
    )  # fmt: skip
    NO_PUBLISHER = (
        "NoPublisher",
        "A topic has no publisher yet, or several types",
        "Start the node or declare the type",
    )
    TYPE_MISSING = (
        "TypeMissing", "The interface package of a topic is not installed beside the agent",
        "Add the package to the agent's image or overlay (`interfaces`)",
    )  # fmt: skip
    QOS_MISMATCH = (
        "QosMismatch", "A topic cannot be heard with the declared quality of service", "Declare what its publisher has"
    )  # fmt: skip
    INCOMPATIBLE_QOS = (
        "IncompatibleQos", "A subscriber of an output's public topic asks for more than the replica's publisher offers",
        "Change the subscriber's quality of service, or that of the replica's publisher",
    )  # fmt: skip
    RELAY_SILENT = (
        "RelaySilent", "The relay of this side does not report, so outputs with `while` are not judged",
        "Look at the agent's log; the relay is started anew by itself",
    )  # fmt: skip
    REALTIME_REFUSED = (
        "RealtimeRefused", "The system refuses real-time priority", "Grant it, or set `realtime` to false"
    )  # fmt: skip
    PROCESS_HUNG = (
        "ProcessHung", "A process of the agent gave no sign of life and was started anew", "Look at the agent's log"
    )  # fmt: skip
    INVARIANT_BROKEN = (
        "InvariantBroken", "A process of the agent reached a state that must not be, ended, and was started anew",
        "Report the agent's log: this is a defect of the agent",
    )  # fmt: skip
    JOURNAL_FULL = (
        "JournalFull", "The relay's journal cannot be allocated: goals are lost when the relay dies",
        "Make room in `runtime_dir`",
    )  # fmt: skip
    OPEN_CALLS_LOST = (
        "OpenCallsLost", "The middleware cannot answer calls that were open when the relay died",
        "Use rmw_fastrtps_cpp on the robot; clients ask again",
    )  # fmt: skip
    CERTIFICATE_NOT_RENEWED = (
        "CertificateNotRenewed", "The robot gets no certificate for a key of its own, and uses the one that it has",
        "Read the message; `CertificateCurrent` of the RobotOffload names the end",
    )  # fmt: skip
    OTHER_VERSION = (
        "OtherVersion", "The other side runs another version of the agent", "Run one version on both sides"
    )  # fmt: skip
    AGENT_HEAVY = (
        "AgentHeavy", "The robot's agent took more than a tenth of the robot's computer for a minute",
        "Lengthen `switching.heartbeatPeriod`, or send fewer messages; a loss is noticed later then",
    )  # fmt: skip
    LIMIT_TOO_TIGHT = (
        "LimitTooTight", "A deadline or an age is so short that it is broken although all is well",
        "Choose the value that the message names",
    )  # fmt: skip
    MESSAGE_TOO_LARGE = (
        "MessageTooLarge", "A message is larger than `maxMessageSize`, or than the agent hands over, and was left out",
        "Make the message smaller (compressed, lower resolution), or raise `switching.maxMessageSize`",
    )  # fmt: skip
    THINNED = (
        "Thinned", "The link does not carry all messages of an input; what would have to wait is left out",
        "Publish it smaller, compressed or more seldom",
    )  # fmt: skip
    MIN_RATE_MISSED = (
        "MinRateMissed", "The link carries fewer messages of an input than its `minRate`",
        "Publish it smaller or compressed, thin other topics, or lower `minRate`",
    )  # fmt: skip
    SNAPSHOT_REFUSED = (
        "SnapshotRefused", "A snapshot of a node's state was refused; the replica keeps what it had",
        "Read the reason in the message; publish with the same `robot_offload_state` on both sides",
    )  # fmt: skip
    PARAMETER_REFUSED = (
        "ParameterRefused", "A replica did not take parameters of the acting side's node",
        "Set it in the parameter file of both sides and restart, or name it in `except`",
    )  # fmt: skip
    NOT_LIFECYCLE = (
        "NotLifecycle", "A node that is declared as managed runs without a lifecycle",
        "Write `lifecycle: false`, or make it a managed node",
    )  # fmt: skip
    NODE_MISSING = (
        "NodeMissing", "A managed node does not run, one with a similar name does",
        "Give the node the name that it has in the graph",
    )  # fmt: skip
    FRAME_TAKEN = (
        "FrameTaken", "Another node publishes a transform that `frames` gives to the group; consumers hear both",
        "Stop the node that the message names from publishing it, or take the frame out of `frames`",
    )  # fmt: skip
    FRAME_UNDECLARED = (
        "FrameUndeclared", "A replica publishes a transform that `frames` of its output does not name; it is left out",
        "Add the frame to `frames`",
    )  # fmt: skip
    UNDECLARED_SERVER = (
        "UndeclaredServer", "A duplicated node serves what is not declared: clients reach their own side's replica",
        "Add the line of the message to the node, or list the name under `switching.silent`",
    )  # fmt: skip
    UNDECLARED_CALL = (
        "UndeclaredCall", "A duplicated node calls a server outside the group, which is not declared",
        "Add the line of the message to the node, or list the name under `switching.silent`",
    )  # fmt: skip
    NODE_UNSEEN = (
        "NodeUnseen", "A node without a lifecycle, or a topic that it is declared to publish, is not in the graph",
        "Start the node under its declared name, and remap its outputs to their private topics",
    )  # fmt: skip
    AUDIT_FAILED = (
        "AuditFailed", "The audit trail on the robot cannot be written; its entries wait",
        "Free the disk, or give each agent a state folder of its own",
    )  # fmt: skip
    RECORDING_FAILED = (
        "RecordingFailed", "A changeover could not be recorded; nothing else is the worse for it",
        "Free the disk, or install `robot-offload-agent[record]`, as the message says",
    )  # fmt: skip
    SETTINGS_REFUSED = (
        "SettingsRefused", "The robot refused settings that the cloud offers", "Read the reason in the message"
    )  # fmt: skip
    SETTINGS_UNREADABLE = (
        "SettingsUnreadable", "The cloud's agent cannot read its settings file", "Look at the ConfigMap of the agent"
    )  # fmt: skip
    KEPT_SETTINGS_DAMAGED = (
        "KeptSettingsDamaged", "The settings kept on the robot's disk cannot be read; its own file holds",
        "Wait until the cloud offers them again",
    )  # fmt: skip
    KEPT_SETTINGS_REFUSED = (
        "KeptSettingsRefused", "The settings kept on the robot's disk no longer fit its own file, which holds",
        "Wait until the cloud offers settings again",
    )  # fmt: skip
    ROBOT_NOT_CONNECTED = (
        "RobotNotConnected", "The cloud's agent hears no robot", "Start the robot's agent, then look at the link"
    )  # fmt: skip
    NOT_OFFERED = "NotOffered", "The cloud's agent has no settings to offer; the robot runs its own file"
    PENDING = "Pending", "The robot has not answered to the settings yet", "Wait"
    CONNECTING = "Connecting", "The robot is heard and has not said yet who acts", "Wait"
    BARE_BEAT = "BareBeat", "A beat without content arrived; it renews nothing", "None, while it is a single one"
    FOREIGN_UID = (
        "ForeignUid", "A beat of another RobotOffload arrived and was ignored", "Separate the two in domain or address"
    )  # fmt: skip
    BAD_VERSION = "BadVersion", "A beat of another version arrived and was ignored", "Run one version on both sides"
    BAD_FORM = "BadForm", "A message that is not a heartbeat arrived and was ignored", "See who else sends to this port"
