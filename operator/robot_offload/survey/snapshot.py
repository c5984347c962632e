"""An observed ROS graph: plain values, read from JSON and written to it.

Parsed at the border: whatever a file holds, this module's results have the right types and bounded sizes. Names are
kept unchanged; whether the resource accepts them is judged where the resource is proposed.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robot_offload.errors import InputError

VERSION: Final = 1
MOST: Final = 10_000
"""Maximum length of each list; a larger graph is not a robot's."""
_Name = Annotated[str, Field(max_length=1024)]
_Names = Annotated[tuple[_Name, ...], Field(max_length=MOST)]
_Number = Annotated[float, Field(ge=0, le=1e15, allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=0, le=10**15)]


class _Seen(BaseModel):
    """What is common to all parts: immutable; what a newer version adds is left aside."""

    model_config = ConfigDict(frozen=True, extra="ignore", hide_input_in_errors=True)


class Endpoint(_Seen):
    """A publisher or a subscription: whose it is, and its quality of service (empty: unknown)."""

    node: _Name
    reliability: Literal["Reliable", "BestEffort", ""] = ""
    durability: Literal["Volatile", "TransientLocal", ""] = ""


class TopicSeen(_Seen):
    """A topic.

    Attributes:
        messages, size, span_s: how many were heard, their bytes, the seconds from the first to the last.
        measured: whether somebody listened at all; otherwise `problem` says why not.
        frames: of transforms: (parent, child).
    """

    name: _Name
    types: _Names = ()
    publishers: Annotated[tuple[Endpoint, ...], Field(max_length=MOST)] = ()
    subscribers: Annotated[tuple[Endpoint, ...], Field(max_length=MOST)] = ()
    messages: _Count = 0
    size: _Count = 0
    span_s: _Number = 0.0
    measured: bool = False
    problem: _Name = ""
    frames: Annotated[tuple[tuple[_Name, _Name], ...], Field(max_length=MOST)] = ()

    @property
    def type(self) -> str:
        """Its message type; empty where it has none or several."""
        return self.types[0] if len(self.types) == 1 else ""

    @property
    def rate_hz(self) -> float:
        """Messages per second; 0 for fewer than three."""
        return (self.messages - 1) / self.span_s if self.messages > 2 and self.span_s > 0 else 0.0

    @property
    def message_size(self) -> float:
        """Bytes of one message on average."""
        return self.size / self.messages if self.messages else 0.0

    @property
    def bytes_per_s(self) -> float:
        """Bytes per second."""
        return self.rate_hz * self.message_size

    @property
    def latched(self) -> bool:
        """Whether every publisher keeps the last messages for those who come late."""
        return bool(self.publishers) and all(it.durability == "TransientLocal" for it in self.publishers)


class NodeSeen(_Seen):
    """A node by its full name.

    Attributes:
        twice: whether two nodes have this name.
        lifecycle: its state; empty: it has no lifecycle.
        services, clients, actions, action_clients: name -> type.
        participants: the first 12 bytes of its endpoints' identifiers, hexadecimal.
        problem: what of it stayed unknown.
    """

    name: _Name
    twice: bool = False
    lifecycle: _Name = ""
    parameters: dict[_Name, bool | int | float | str | list[bool] | list[int] | list[float] | list[str]] = {}
    services: dict[_Name, _Name] = {}
    clients: dict[_Name, _Name] = {}
    actions: dict[_Name, _Name] = {}
    action_clients: dict[_Name, _Name] = {}
    participants: _Names = ()
    problem: _Name = ""

    @property
    def managed(self) -> bool:
        """Whether it has a lifecycle."""
        return bool(self.lifecycle)


class ProcessSeen(_Seen):
    """A process of the host on which the graph was looked at.

    Attributes:
        inner_pid: its number in its own container.
        folder: its working folder.
        cpu: its use of the processor, 1.0 is one core.
        memory: bytes.
        devices: what it has open under /dev.
        parameter_files: what it was started with, path -> text.
    """

    pid: _Count
    inner_pid: _Count = 0
    command: Annotated[tuple[str, ...], Field(max_length=MOST)] = ()
    folder: _Name = ""
    cpu: _Number = 0.0
    memory: _Count = 0
    devices: _Names = ()
    parameter_files: dict[_Name, str] = {}


class GraphSnapshot(_Seen):
    """A ROS graph, looked at for some seconds."""

    version: Literal[1] = VERSION
    seconds: _Number = 0.0
    host: _Name = ""
    cores: _Count = 1
    domain_id: _Count = 0
    rmw: _Name = ""
    distro: _Name = ""
    participant: _Name = ""
    nodes: Annotated[tuple[NodeSeen, ...], Field(max_length=MOST)] = ()
    topics: Annotated[tuple[TopicSeen, ...], Field(max_length=MOST)] = ()
    processes: Annotated[tuple[ProcessSeen, ...], Field(max_length=MOST)] = ()


def read(text: str | bytes, source: str) -> GraphSnapshot:
    """Return the graph that a JSON text holds.

    Args:
        text: what `robot-offload import --snapshot` or the program of `--program` wrote.
        source: what to call it in messages.

    Raises:
        InputError: it holds something else.
    """
    try:
        return GraphSnapshot.model_validate_json(text)
    except ValidationError as error:
        first: Any = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"{source}: no graph of `robot-offload import --snapshot`: {f'{where}: ' if where else ''}{first['msg']}"
        ) from None


def write(graph: GraphSnapshot) -> str:
    """Return the graph as JSON."""
    return graph.model_dump_json(indent=1)
