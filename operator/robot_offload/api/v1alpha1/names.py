"""Names of ROS 2 and Kubernetes, checked where they are written down instead of where they first fail.

Topics, services, nodes and namespaces follow the design articles "Topic and Service name mapping to DDS" and
"Interface definition" of design.ros2.org and the limits of rmw's own validators; a contract test holds them
against those. One rule is ours: no `__` in a topic, because that is how a topic becomes an identifier (`/a/b`
-> `a__b`).
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import AfterValidator, WithJsonSchema

from robot_offload.api.v1alpha1.name_rules import (
    DOUBLED,
    OUR_NODE,
    OURS_ABSOLUTE,
    OURS_ANYWHERE,
    OURS_NAMESPACE,
    RENAMED,
    REPLICA,
    NameRule,
    keeps,
    shown,
)

Side: TypeAlias = Literal["robot", "cloud"]
"""The two sides."""
SIDES: Final[tuple[Side, Side]] = ("robot", "cloud")

# rmw allows 247 characters (255 less the 8 of DDS prefixes); private copies of an output put 14 before it.
MAX_TOPIC_LENGTH: Final = 247 - len("/offload/robot")
MAX_ACTION_LENGTH: Final = MAX_TOPIC_LENGTH - len("/_action/cancel_goal")
"""An action has hidden services and topics; this is the longest of their names."""
MAX_NAME_LENGTH: Final = 63
"""Of a resource and of a node: both become part of Kubernetes labels."""

_WORD = r"[A-Za-z_][A-Za-z0-9_]*"
_TOPIC = rf"^(/{_WORD})+$"
_NAMESPACE = rf"^(/|(/{_WORD})+)$"
_NODE = rf"^{_WORD}$"
RESOURCE_PATTERN = r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$"
_PACKAGE = r"^[a-z](_?[a-z0-9])*$"
_MESSAGE_TYPE = r"^[a-z](_?[a-z0-9])*/msg/[A-Z][A-Za-z0-9]*$"
_SERVICE_TYPE = r"^[a-z](_?[a-z0-9])*/srv/[A-Z][A-Za-z0-9]*$"
_ACTION_TYPE = r"^[a-z](_?[a-z0-9])*/action/[A-Z][A-Za-z0-9]*$"
_FRAME = r"^[A-Za-z0-9_][A-Za-z0-9_./-]*$"
_NODE_PATH = rf"^/?{_WORD}(/{_WORD})*$"
_TOPIC_GLOB = rf"^(/?{_WORD}(/{_WORD})*(/\*\*?)?|\*\*)$"
_EXECUTABLE = r"^[A-Za-z0-9_][A-Za-z0-9_.+-]*$"
PORT_PATTERN: Final = r"(6553[0-5]|655[0-2][0-9]|65[0-4][0-9]{2}|6[0-4][0-9]{3}|[1-5][0-9]{4}|[1-9][0-9]{0,3})"
_PATH_PART: Final = r"[a-z0-9]+((\.|_|__|-+)[a-z0-9]+)*"
_SETUP: Final = r"^(/[A-Za-z0-9_+-][A-Za-z0-9._+-]*)+\.(ba)?sh$"
IMAGE_PATTERN: Final = (
    rf"^([A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?(\.[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?)*(:{PORT_PATTERN})?/)?"
    rf"{_PATH_PART}(/{_PATH_PART})*(:[A-Za-z0-9_][A-Za-z0-9._-]{{0,127}})?(@sha256:[0-9a-f]{{64}})?$"
)
"""A reference of an image, as the grammar of distribution (pkg reference) has it, with digests of sha256."""
MAX_IMAGE_LENGTH: Final = 512
_RMW = r"^rmw_[a-z0-9_]+$"
_DNS_LABEL = r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?"
_DNS_NAME = rf"^{_DNS_LABEL}(\.{_DNS_LABEL})*$"
_OBJECT_PART = r"[a-z0-9]([-a-z0-9]*[a-z0-9])?"
_OBJECT_NAME = rf"^{_OBJECT_PART}(\.{_OBJECT_PART})*$"
_HOST_LABEL = r"[A-Za-z0-9]([-A-Za-z0-9]{0,61}[A-Za-z0-9])?"
_ADDRESS = rf"^({_HOST_LABEL}(\.{_HOST_LABEL})*|[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*)$"
_LOOKS_LIKE_IP = r"^([0-9.]*\.[0-9]+|.*:.*)$"
_NAME_PART = r"[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?"
_LABEL_KEY = rf"^({_OBJECT_PART}(\.{_OBJECT_PART})*/)?{_NAME_PART}$"
_LABEL_VALUE = rf"^({_NAME_PART})?$"
_VARIABLE = r"^[A-Za-z_][A-Za-z0-9_]*$"
_CONFIG_KEY = r"^([-_a-zA-Z0-9][-._a-zA-Z0-9]*|\.[-_a-zA-Z0-9][-._a-zA-Z0-9]*)$"
_REMAPPED = rf"^(~/)?/?{_WORD}(/{_WORD})*$"


def identifier(topic: str) -> str:
    """Return a topic as a name without slashes, for parameters, channels and metrics: `/a/b` -> `a__b`."""
    return topic.strip("/").replace("/", "__")


def _check_topic(text: str) -> str:
    if not text.startswith("/"):
        raise ValueError(f"{shown(text)} must start with a slash, as `ros2 topic list` shows it")
    if len(text) > MAX_TOPIC_LENGTH:
        raise ValueError(f"is {len(text)} characters long; at most {MAX_TOPIC_LENGTH} fit")
    keeps(text, OURS_ABSOLUTE, DOUBLED)
    if not re.fullmatch(_TOPIC, text):
        raise ValueError(
            f"{shown(text)} is not a full name; write /word/word with letters, digits and underscores, "
            "no word starting with a digit and no slash at the end"
        )
    return text


def _check_namespace(text: str) -> str:
    if len(text) > MAX_TOPIC_LENGTH or not re.fullmatch(_NAMESPACE, text):
        raise ValueError(f"{shown(text)} is not a namespace; write / or /word, with a slash first and none last")
    keeps(text, DOUBLED, OURS_NAMESPACE)
    return text


def _check_node(text: str) -> str:
    if "/" in text:
        raise ValueError(f"{shown(text)} holds a slash; give the name without its namespace")
    if len(text) > MAX_NAME_LENGTH or not re.fullmatch(_NODE, text):
        raise ValueError(
            f"{shown(text)} is not a node name; use letters, digits and underscores, no digit first, "
            f"at most {MAX_NAME_LENGTH}"
        )
    keeps(text, REPLICA, OUR_NODE)
    return text


def _check_resource(text: str) -> str:
    if len(text) > MAX_NAME_LENGTH or not re.fullmatch(RESOURCE_PATTERN, text):
        raise ValueError(
            f"{shown(text)} is not a Kubernetes name; use lower-case letters, digits and dashes, "
            f"no dash first or last, at most {MAX_NAME_LENGTH}"
        )
    return text


def _check_message_type(text: str) -> str:
    if not re.fullmatch(_MESSAGE_TYPE, text):
        raise ValueError(f"{shown(text)} is not a message type; write package/msg/Type, e.g. std_msgs/msg/String")
    return text


def _check_action(text: str) -> str:
    if len(text) > MAX_ACTION_LENGTH:
        raise ValueError(f"is {len(text)} characters long; at most {MAX_ACTION_LENGTH} fit for an action")
    return _check_topic(text)


def _matching(pattern: str, what: str, max_length: int = 255) -> Callable[[str], str]:
    def check(text: str) -> str:
        if len(text) > max_length or not re.fullmatch(pattern, text):
            raise ValueError(f"{shown(text)} is not {what}")
        return text

    return check


def _check_address(text: str) -> str:
    _matching(_ADDRESS, "an address; write an IP address or a DNS name, without a port", 253)(text)
    keeps(text, _REACHABLE)
    return text


def _check_host(text: str) -> str:
    _matching(_DNS_NAME, "a DNS name; write it in lower case and without a port, with at most 63 characters between "
              "two dots", 253)(text)  # fmt: skip
    keeps(text, _REACHABLE)
    return text


def _no_machine(text: str) -> bool:
    """Return whether a text is no IP address by which one machine can be reached."""
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return True
    mapped = isinstance(address, ipaddress.IPv6Address) and (address.ipv4_mapped or address.scope_id)
    return bool(mapped or address.is_unspecified or address.is_multicast)


def _no_range(text: str) -> bool:
    """Return whether a text is no range of addresses; the library takes one address for a range of one."""
    try:
        ipaddress.ip_network(text)
    except ValueError:
        return True
    return "/" not in text


def _check_ip(text: str) -> str:
    keeps(text, _IS_IP)
    return text


def _check_range(text: str) -> str:
    keeps(text, _IS_RANGE)
    return text


def _check_remapped(text: str) -> str:
    keeps(text, RENAMED)
    if len(text) > 255 or not re.fullmatch(_REMAPPED, text):
        raise ValueError(f"{shown(text)} is not a ROS name; write /name, name or ~/name")
    keeps(text, OURS_ANYWHERE)
    return text


def _schema(pattern: str, max_length: int = 255, rules: tuple[NameRule, ...] = ()) -> WithJsonSchema:
    """Return what the API server holds a name against: a pattern, a length, and rules for the rest."""
    schema: dict[str, Any] = {"type": "string", "minLength": 1, "maxLength": max_length, "pattern": pattern}
    if rules:
        schema["x-kubernetes-validations"] = [{"rule": rule.cel, "message": rule.text} for rule in rules]
    return WithJsonSchema(schema)


_TOPIC_SCHEMA = _schema(_TOPIC, MAX_TOPIC_LENGTH, (DOUBLED, OURS_ABSOLUTE))

TopicName = Annotated[str, AfterValidator(_check_topic), _TOPIC_SCHEMA]
ServiceName = Annotated[str, AfterValidator(_check_topic), _TOPIC_SCHEMA]
ActionName = Annotated[str, AfterValidator(_check_action), _schema(_TOPIC, MAX_ACTION_LENGTH, (DOUBLED, OURS_ABSOLUTE))]
Namespace = Annotated[
    str,
    AfterValidator(_check_namespace),
    _schema(_NAMESPACE, MAX_TOPIC_LENGTH, (DOUBLED, OURS_NAMESPACE)),
]
NodeName = Annotated[
    str,
    AfterValidator(_check_node),
    _schema(_NODE, MAX_NAME_LENGTH, (REPLICA, OUR_NODE)),
]
ResourceName = Annotated[str, AfterValidator(_check_resource), _schema(RESOURCE_PATTERN, MAX_NAME_LENGTH)]
MessageType = Annotated[str, AfterValidator(_check_message_type), _schema(_MESSAGE_TYPE)]
ServiceType = Annotated[
    str,
    AfterValidator(_matching(_SERVICE_TYPE, "a service type; write package/srv/Type, e.g. nav_msgs/srv/GetPlan")),
    _schema(_SERVICE_TYPE),
]
ActionType = Annotated[
    str,
    AfterValidator(
        _matching(_ACTION_TYPE, "an action type; write package/action/Type, e.g. nav2_msgs/action/FollowPath")
    ),
    _schema(_ACTION_TYPE),
]
FrameName = Annotated[
    str,
    AfterValidator(_matching(_FRAME, "a frame; write its name without a slash first, e.g. base_link")),
    _schema(_FRAME),
]
NodePath = Annotated[
    str,
    AfterValidator(_matching(_NODE_PATH, "a node; write name or namespace/name, e.g. local_costmap/local_costmap")),
    _schema(_NODE_PATH),
]
"""A node by its name, relative to the robot's namespace or absolute; child nodes too."""
TopicGlob = Annotated[
    str,
    AfterValidator(_matching(_TOPIC_GLOB, "a name or a group of names; write /name, name/* or name/**")),
    _schema(_TOPIC_GLOB),
]
"""A topic, or all topics below a name: `/*` one level, `/**` every level."""
PackageName = Annotated[
    str,
    AfterValidator(_matching(_PACKAGE, "a ROS package; use lower-case letters, digits and underscores")),
    _schema(_PACKAGE),
]
ExecutableName = Annotated[
    str,
    AfterValidator(_matching(_EXECUTABLE, "an executable's name; give it without a folder")),
    _schema(_EXECUTABLE),
]
ImageName = Annotated[
    str,
    AfterValidator(
        _matching(
            IMAGE_PATTERN,
            "an image; write registry/name:tag or registry/name@sha256:digest (64 digits), with a port from 1 to 65535",
            MAX_IMAGE_LENGTH,
        )
    ),
    _schema(IMAGE_PATTERN, MAX_IMAGE_LENGTH),
]
SetupFile = Annotated[
    str,
    AfterValidator(_matching(_SETUP, "a setup script; write its whole path, e.g. /opt/ws/install/setup.bash", 255)),
    _schema(_SETUP, 255),
]
RmwName = Annotated[
    str,
    AfterValidator(_matching(_RMW, "a ROS middleware; write e.g. rmw_fastrtps_cpp")),
    _schema(_RMW),
]
# CEL knows multicast of one kind only, so that the first byte is judged as text.
_ONE_MACHINE = (
    "isIP(self) && !ip(self).isUnspecified() && !self.matches('^(2(2[4-9]|3[0-9])[.]|[fF][fF][0-9A-Fa-f]{2}:)')"
)
_MACHINE = "IP address of one machine, e.g. 192.0.2.10 or 2001:db8::10"
_IS_IP = NameRule(_ONE_MACHINE, _no_machine, f"must be the {_MACHINE}")
_REACHABLE = NameRule(
    f"!self.matches('{_LOOKS_LIKE_IP.replace(chr(92) + '.', '[.]')}') || ({_ONE_MACHINE})",
    lambda text: bool(re.fullmatch(_LOOKS_LIKE_IP, text)) and _no_machine(text),
    f"must be the {_MACHINE}, or a DNS name",
)
DNSName = Annotated[str, AfterValidator(_check_host), _schema(_DNS_NAME, 253, (_REACHABLE,))]
ObjectName = Annotated[
    str,
    AfterValidator(
        _matching(_OBJECT_NAME, "the name of a Kubernetes object; use lower-case letters, digits, - and .", 253)
    ),
    _schema(_OBJECT_NAME, 253),
]
IPAddress = Annotated[str, AfterValidator(_check_ip), _schema(r"^[0-9A-Fa-f:.]+$", 45, (_IS_IP,))]
_IS_RANGE = NameRule(
    "isCIDR(self) && cidr(self).masked() == cidr(self)",
    _no_range,
    "must be a range of addresses that begins with its first one, e.g. 198.51.100.0/24",
)
AddressRange = Annotated[
    str,
    AfterValidator(_check_range),
    _schema(
        r"^[0-9A-Fa-f:.]+/[0-9]{1,3}$",
        49,
        (_IS_RANGE,),
    ),
]
Address = Annotated[str, AfterValidator(_check_address), _schema(_ADDRESS, 253, (_REACHABLE,))]
LabelKey = Annotated[
    str,
    AfterValidator(_matching(_LABEL_KEY, "the name of a label or annotation; write name or prefix/name", 316)),
    _schema(_LABEL_KEY, 316),
]
LabelValue = Annotated[
    str,
    AfterValidator(_matching(_LABEL_VALUE, "a label's value; use letters, digits, -, _ and .", MAX_NAME_LENGTH)),
    WithJsonSchema({"type": "string", "maxLength": MAX_NAME_LENGTH, "pattern": _LABEL_VALUE}),
]
VariableName = Annotated[
    str,
    AfterValidator(_matching(_VARIABLE, "the name of an environment variable; use letters, digits and underscores")),
    _schema(_VARIABLE),
]
RemappedName = Annotated[str, AfterValidator(_check_remapped), _schema(_REMAPPED, 255, (RENAMED, OURS_ANYWHERE))]
"""A name in a remapping: absolute, relative or private."""
ConfigKey = Annotated[
    str,
    AfterValidator(_matching(_CONFIG_KEY, "a key of a ConfigMap; use letters, digits, -, _ and .", 253)),
    _schema(_CONFIG_KEY, 253),
]
