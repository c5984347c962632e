"""Dockerfiles as a real parser sees them (dockerfile-parse), and their shell commands."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path

from dockerfile_parse import DockerfileParser


def instructions(text: str) -> list[tuple[str, str]]:
    """Every instruction with its value, comments left out."""
    parser = DockerfileParser(fileobj=io.BytesIO(text.encode()), env_replace=False)
    return [(entry["instruction"], entry["value"]) for entry in parser.structure if entry["instruction"] != "COMMENT"]


def assignments(text: str) -> list[tuple[str, str]]:
    """Name and value, as written, of every ENV and LABEL instruction."""
    return [
        (name, value)
        for instruction, rest in instructions(text)
        if instruction in ("ENV", "LABEL")
        for name, value in re.findall(r'([\w.-]+)=("(?:[^"\\]|\\.)*")(?:\s+|$)', rest)
    ]


def shell_commands(text: str) -> list[str]:
    """What the shell gets of each RUN instruction: joined lines, without the options of RUN."""
    joined = re.sub(r"\\\n", "", "\n".join(line for line in text.splitlines() if not re.match(r"\s*#", line)))
    runs = (line.removeprefix("RUN ") for line in joined.splitlines() if line.startswith("RUN "))
    return [re.sub(r"^(\s*--[a-z]+=\S+)+\s*", "", run) for run in runs]


def program(name: str) -> str:
    """The path of a program of this Python's environment."""
    return str(Path(sys.executable).parent / name)
