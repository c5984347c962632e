"""Users' ROS 2 parameter files for replicas: the replica of `controller_server` is called `remote_controller_server`.

ROS 2 gives a node the parameters that stand under its own name, so without a new key a replica would silently run with
its defaults. Only the keys are changed, in the text as it is: reading and writing YAML anew could turn a number into a
text or a double into an integer.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import yaml

_PARAMETERS: Final = "ros__parameters"


def renamed(text: str, name: str, replica: str) -> str:
    """A parameter file for a replica.

    Args:
        text: the user's file; one that is no YAML comes back as it is, ROS 2 tells what is wrong with it.
        name: of the node, without its namespace.
        replica: what the replica is called.
    """
    try:
        document = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError:
        return text
    for key in sorted(_keys(document, name), key=lambda one: one.start_mark.index, reverse=True):
        value = str(key.value)
        text = text[: key.start_mark.index] + value[: -len(name)] + replica + text[key.end_mark.index :]
    return text


def _keys(node: yaml.Node | None, name: str) -> Iterator[yaml.ScalarNode]:
    """The keys under which parameters of the node stand; namespaces may be part of a key or keys of their own."""
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        if not isinstance(value, yaml.MappingNode) or not isinstance(key, yaml.ScalarNode):
            continue
        holds = any(isinstance(inner, yaml.ScalarNode) and inner.value == _PARAMETERS for inner, _ in value.value)
        if holds and key.value.rpartition("/")[2] == name:
            yield key
        elif not holds:
            yield from _keys(value, name)
