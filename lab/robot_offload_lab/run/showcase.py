"""What an example states about itself for a demo, in a file `demo.yaml` beside its RobotOffload."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, ValidationError

from robot_offload.api.strict_yaml import YamlError, parse
from robot_offload.errors import InputError

FILE: Final = "demo.yaml"


class Together(BaseModel):
    """Nodes that share one process on each side, as components of a container do.

    Attributes:
        name: name of the process.
        command: the program; the names of the nodes to run are appended, then their ROS arguments.
        nodes: the nodes, by their names in the RobotOffload. They need no `run` of their own.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

    name: str
    command: tuple[str, ...]
    nodes: tuple[str, ...]


class Showcase(BaseModel):
    """The content of the file.

    Attributes:
        state: topic on which the application reports its drive (`judge.translate.drive`); empty: it does not, and the
            report lacks collisions, stops and goal.
        account: topic on which a client on the robot reports what became of its goals and calls (`judge.accounts`).
        restored: topic on which the acting replica of a node with state reports how old its initial state was.
        interfaces: folders of interface packages that the nodes need and no wheel contains; built before the run.
        processes: which nodes share a process; every other node has one of its own.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

    state: str = ""
    account: str = ""
    restored: str = ""
    interfaces: tuple[str, ...] = ()
    processes: tuple[Together, ...] = ()

    @property
    def accounts(self) -> dict[str, str]:
        """The topics of the application's own accounts, by their names here."""
        return {"state": self.state, "account": self.account, "restored": self.restored}


def showcase(spec: Path) -> Showcase:
    """Read the file beside a RobotOffload; return an empty Showcase without one.

    Raises:
        InputError: the file exists but cannot be understood.
    """
    path = spec.parent / FILE
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return Showcase()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    try:
        return Showcase.model_validate(parse(text) or {})
    except YamlError as error:
        raise InputError(f"{path}: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: {field}: {first['msg']}; write for example state: /vehicle/state") from error
