"""What a pattern cannot say of a name, once for both who judge it: the API server (in CEL) and Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

OWN_NODES: Final = ("network_monitor", "cloud_switcher", "guardian")
"""The agent's nodes on the robot; in the cloud they carry the prefix."""
REMOTE_PREFIX: Final = "remote_"
OWN_TOPICS: Final = (
    "/connectivity_test_local",
    "/connectivity_test_remote",
    "/network_status",
    "/remote_network_status",
)
OWN_TOPIC_PREFIX: Final = "/offload/"


@dataclass(frozen=True, slots=True)
class NameRule:
    """What a pattern cannot say of a name, once for both who judge it.

    Attributes:
        cel: what must hold, for the API server.
        broken: the opposite, for Python.
        text: what is wrong and what to write instead; Python puts the name before it.
    """

    cel: str
    broken: Callable[[str], bool]
    text: str


def cel_list(words: tuple[str, ...]) -> str:
    """Return a list of texts in CEL."""
    return f"[{', '.join(repr(word) for word in words)}]"


def own_topic(name: str) -> bool:
    """Return whether a topic, absolute or relative to the root, is one of the agents' own."""
    absolute = f"/{name.lstrip('/')}"
    return absolute in OWN_TOPICS or absolute.startswith(OWN_TOPIC_PREFIX)


_OURS: Final = "belongs to the agents; use another name"
OURS_ABSOLUTE: Final = NameRule(
    f"!self.startsWith('{OWN_TOPIC_PREFIX}') && !(self in {cel_list(OWN_TOPICS)})",
    lambda text: text in OWN_TOPICS or text.startswith(OWN_TOPIC_PREFIX),
    _OURS,
)
OURS_ANYWHERE: Final = NameRule(
    f"!self.startsWith('{OWN_TOPIC_PREFIX}') && !self.startsWith('{OWN_TOPIC_PREFIX[1:]}') && "
    f"!(self in {cel_list(OWN_TOPICS + tuple(topic[1:] for topic in OWN_TOPICS))})",
    own_topic,
    _OURS,
)
OURS_NAMESPACE: Final = NameRule(
    f"!(self + '/').startsWith('{OWN_TOPIC_PREFIX}')",
    lambda text: f"{text}/".startswith(OWN_TOPIC_PREFIX),
    "belongs to the agents; use another namespace",
)
DOUBLED: Final = NameRule(
    "!self.contains('__')",
    lambda text: "__" in text,
    "holds two underscores in a row; ROS 2 keeps them for itself",
)
RENAMED: Final = NameRule(
    DOUBLED.cel,
    DOUBLED.broken,
    "holds two underscores in a row, as __node and __ns do; the agents find a node by its name and namespace, so these "
    "stay as they are",
)
REPLICA: Final = NameRule(
    f"!self.startsWith('{REMOTE_PREFIX}')",
    lambda text: text.startswith(REMOTE_PREFIX),
    f"carries the prefix of cloud replicas ({REMOTE_PREFIX}); leave it out",
)
OUR_NODE: Final = NameRule(
    f"!(self in {cel_list(OWN_NODES)})",
    lambda text: text in OWN_NODES,
    "is the name of one of the agent's own nodes; choose another one",
)


def keeps(text: str, *rules: NameRule) -> None:
    """Hold a name against rules.

    Raises:
        ValueError: it breaks one.
    """
    for rule in rules:
        if rule.broken(text):
            raise ValueError(f"{shown(text)} {rule.text}")


def shown(text: str) -> str:
    """Return `text` quoted on one line, cut to a readable length; what only looks like Latin letters is spelled out."""
    quoted = ascii(text)
    return quoted if len(quoted) <= 60 else f"{quoted[:56]}...'"
