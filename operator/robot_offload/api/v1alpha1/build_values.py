"""The values that a user may put into an image: each one is held against a pattern before it reaches any text.

What ends in a shell command or in a file name takes few characters. What is free text (values of variables, arguments,
labels) takes every character that can be seen; the filters of `images.quoting` make it inert.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import AfterValidator, Field, WithJsonSchema

from robot_offload.api.v1alpha1.names import IMAGE_PATTERN, PORT_PATTERN

DistroName: TypeAlias = Literal["foxy", "humble", "jazzy", "kilted", "rolling"]
MAX_TEXT: Final = 4096
MAX_LISTED: Final = 64
"""Entries of a list at most, as an API server wants to know."""

_URL = r"[A-Za-z0-9._~/:+-]+"
_USER = r"[a-z0-9_][a-z0-9_-]*@"
_GIT_HOST = r"[A-Za-z0-9][A-Za-z0-9.-]*"
_GIT_PORT_PATH = rf"(:{PORT_PATTERN})?(/[A-Za-z0-9._~/:+-]*)?"
_GIT_URL = (
    rf"^((https://|ssh://({_USER})?){_GIT_HOST}{_GIT_PORT_PATH}|file:///{_URL}|"
    rf"{_USER}{_GIT_HOST}:[A-Za-z0-9._~:+]({_URL})?)$"
)
_GIT_REF = r"^[A-Za-z0-9_]([./]?[A-Za-z0-9_+-])*$"
_FOLDER = r"\.*[A-Za-z0-9_]([A-Za-z0-9_. +-]*[A-Za-z0-9_.+-])?"
_PATH = rf"^(\.|{_FOLDER}(/{_FOLDER})*)$"
_APT = r"^[a-z0-9][a-z0-9.+-]*[a-z0-9+.](=[A-Za-z0-9.+:~-]+\*?)?$"
_PIP = (
    r"^[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?(\[[A-Za-z0-9._-]+(,[A-Za-z0-9._-]+)*\])?"
    r"((==|~=|!=|<=|>=|<|>)[A-Za-z0-9.*+!_-]+(,(==|~=|!=|<=|>=|<|>)[A-Za-z0-9.*+!_-]+)*)?$"
)
_HOST = r"[a-z0-9]([a-z0-9-]*[a-z0-9])?"
_PORT = rf"(:{PORT_PATTERN})"
# A first word without a dot and without a port would be taken for a folder of Docker Hub.
_REPOSITORY = rf"^({_HOST}(\.{_HOST})+{_PORT}?|{_HOST}{_PORT})(/[a-z0-9]+((\.|_|__|-+)[a-z0-9]+)*)*$"
_VARIABLE = r"^[A-Za-z_][A-Za-z0-9_]*$"
_LABEL = r"^[a-z0-9]+([._-][a-z0-9]+)*$"
_HOST_PORT = r"^[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?(:[0-9]{1,5})?$"
_CMAKE = r"^-D[A-Za-z_][A-Za-z0-9_]*(:[A-Z]+)?=[A-Za-z0-9_.,:;=/+ -]*$"
_ROSDEP_KEY = r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$"
_LAUNCH_FILE = r"^[A-Za-z0-9_][A-Za-z0-9_.-]*\.(py|xml|yaml|yml)$"
_NODE = r"^(/[A-Za-z_][A-Za-z0-9_]*)+$"


def commit(ref: str) -> str | None:
    """Return `ref` when it names one commit for ever (40 hexadecimal digits), else None."""
    return ref if re.fullmatch(r"[0-9a-f]{40}", ref) else None


def shown(text: str) -> str:
    """Return `text` quoted on one line, cut to a readable length."""
    quoted = ascii(text)
    return quoted if len(quoted) <= 60 else f"{quoted[:56]}...'"


def _matching(pattern: str, advice: str, max_length: int = 255) -> Callable[[str], str]:
    def check(text: str) -> str:
        if len(text) > max_length or not re.fullmatch(pattern, text):
            raise ValueError(f"{shown(text)} is not possible here; {advice}")
        return text

    return check


def _check_git_url(text: str) -> str:
    if "://" in text and "@" in text and not text.startswith("ssh://"):
        raise ValueError(
            "an address with a user or a password would be readable in the image; write it without, "
            "and choose credentials: Token"
        )
    if ".." in re.split(r"[/:]", text):
        raise ValueError(f"{shown(text)} leaves its own folder with '..'; write the whole address")
    return _matching(_GIT_URL, "write https://host/path, ssh://host/path, user@host:path or file:///path", 1024)(text)


def _check_git_ref(text: str) -> str:
    if text.endswith(".lock"):
        raise ValueError(f"{shown(text)} ends with .lock, as no branch and no tag may; name another one")
    return _matching(_GIT_REF, "write a branch, a tag or a commit")(text)


def _check_path(text: str) -> str:
    if len(text) > 1024 or not re.fullmatch(_PATH, text):
        raise ValueError(
            f"{shown(text)} is not a path inside the workspace; write folder/folder without '..', a slash first or "
            "last, and special characters"
        )
    return text


def _check_text(text: str) -> str:
    if len(text) > MAX_TEXT:
        raise ValueError(f"is {len(text)} characters long; at most {MAX_TEXT} fit")
    for character in text:
        # Other, line and paragraph separators: nothing that a parser could take for the end of a line.
        if unicodedata.category(character) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"):
            raise ValueError(f"{shown(text)} holds a character that cannot be seen ({shown(character)}); leave it out")
    return text


def _check_host_port(text: str) -> str:
    _matching(_HOST_PORT, "write host or host:port")(text)
    _, colon, port = text.partition(":")
    if colon and not 1 <= int(port) <= 65535:
        raise ValueError(f"{shown(text)} has a port that does not exist; ports go from 1 to 65535")
    return text


def _schema(pattern: str, max_length: int = 255, rule: tuple[str, str] | None = None) -> WithJsonSchema:
    """Return what the API server holds a value against: a pattern, a length, and (CEL rule, message) for the rest."""
    schema: dict[str, Any] = {"type": "string", "minLength": 1, "maxLength": max_length, "pattern": pattern}
    if rule:
        schema["x-kubernetes-validations"] = [{"rule": rule[0], "message": rule[1]}]
    return WithJsonSchema(schema)


GitUrl = Annotated[
    str,
    AfterValidator(_check_git_url),
    _schema(
        _GIT_URL,
        1024,
        rule=("!self.matches('(^|[/:])[.][.](/|$)')", "leaves its own folder with '..'; write the whole address"),
    ),
]
GitRef = Annotated[
    str,
    AfterValidator(_check_git_ref),
    _schema(
        _GIT_REF,
        rule=("!self.endsWith('.lock')", "ends with .lock, as no branch and no tag may; name another one"),
    ),
]
RelativePath = Annotated[str, AfterValidator(_check_path), _schema(_PATH, 1024)]
Repository = Annotated[
    str,
    AfterValidator(_matching(_REPOSITORY, "write host/path or host:port/path, in lower case and without a tag", 200)),
    _schema(_REPOSITORY, 200),
]
Text = Annotated[str, AfterValidator(_check_text), Field(max_length=MAX_TEXT)]
Address = Annotated[str, AfterValidator(_check_host_port), Field(max_length=255)]
AptPackage = Annotated[
    str, AfterValidator(_matching(_APT, "write a Debian package, e.g. libyaml-cpp-dev or name=version")), _schema(_APT)
]
PipPackage = Annotated[
    str, AfterValidator(_matching(_PIP, "write a Python package, e.g. numpy or numpy==2.1.0")), _schema(_PIP)
]
BaseImage = Annotated[
    str,
    AfterValidator(_matching(IMAGE_PATTERN, "write registry/name:tag or registry/name@sha256:digest", 512)),
    _schema(IMAGE_PATTERN, 512),
]
VariableName = Annotated[
    str, AfterValidator(_matching(_VARIABLE, "use letters, digits and underscores, no digit first")), _schema(_VARIABLE)
]
LabelName = Annotated[
    str,
    AfterValidator(_matching(_LABEL, "use lower-case letters, digits, dots and dashes, e.g. org.example.team")),
    _schema(_LABEL),
]
CmakeArgument = Annotated[str, AfterValidator(_matching(_CMAKE, "write -DNAME=value")), _schema(_CMAKE)]
RosdepKey = Annotated[
    str, AfterValidator(_matching(_ROSDEP_KEY, "write a rosdep key, e.g. libopencv-dev")), _schema(_ROSDEP_KEY)
]
LaunchFile = Annotated[
    str,
    AfterValidator(_matching(_LAUNCH_FILE, "write the file's name without a folder, e.g. bringup.launch.py")),
    _schema(_LAUNCH_FILE),
]
FullNodeName = Annotated[
    str, AfterValidator(_matching(_NODE, "write it with its namespace, e.g. /talker")), _schema(_NODE)
]
