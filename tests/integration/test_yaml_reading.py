"""What `validate` reads is what `kubectl apply` stores: every scalar, as a value and as a key, on a real API server."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import pytest

from robot_offload.api import scalars
from robot_offload.api.strict_yaml import YamlError, parse, thaw
from robot_offload_lab.cluster.commands import Kubectl

pytestmark = pytest.mark.api

WORDS = [
    spelled
    for word in ("y", "n", "yes", "no", "on", "off", "true", "false", "null", "x", "yellow", "none", "~", "inf", "nan")
    for spelled in (word, word.capitalize(), word.upper())
]
DIGITS = [
    "0", "1", "7", "00", "07", "08", "0777", "0o17", "0O17", "0b11", "0B11", "0x1F", "0X1f", "1_000", "0x_1", "1.5",
    ".5", "5.", "1.5_0", "1e5", "1E5", "1e+5", "1e", "1.5e3", ".e3", "e3", "1e23", "123456789012345678",
    "1234567890123456789", "9223372036854775807", "9223372036854775808", "18446744073709551615",
    "18446744073709551616", "0x7fffffffffffffff", "1.2.3", "1:30", "10:30:00", "2024-01-01", "2024-1-1",
    "2024-01-01T10:00:00Z", "192.0.2.1", "0.", "00.5", "09.5", "1e400", "1e-400", "0x", "0b", "0o", "0b2",
    "0x1p-2", ".", "..", "--", "5ms", "1,5"
]  # fmt: skip
NUMBERS = [f"{sign}{digits}" for sign in ("", "-", "+") for digits in DIGITS]
TEXTS = list(dict.fromkeys([*WORDS, *NUMBERS]))
HEAD = """\
apiVersion: robotoffload.dev/v1alpha1
kind: RobotOffload
metadata: {name: scalars}
spec:
  nodes:
  - name: talker
    placement: Robot
    run:
      command: [talker]
      parameters:
"""


def stored(kubectl: Kubectl, file: Path, lines: list[str]) -> dict[str, Any]:
    """The parameters that the server would store for these lines."""
    file.write_text(HEAD + "".join(f"        {line}\n" for line in lines))
    sent = kubectl("create", "--dry-run=server", "-o", "json", "-f", str(file))
    found: dict[str, Any] = json.loads(sent)["spec"]["nodes"][0]["run"]["parameters"]
    return found


def test_kubectl_reads_every_scalar_as_we_say_it_does(kubectl: Kubectl, tmp_path: Path) -> None:
    finite = [text for text in TEXTS if not _endless(scalars.by_kubectl(text)) and not text.startswith("--")]
    found = stored(kubectl, tmp_path / "f.yaml", [f"p{n}: {text}" for n, text in enumerate(finite)])
    read = [scalars.by_kubectl(text) for text in finite]
    kept = [found.get(f"p{n}") for n in range(len(finite))]
    differ = [row for row in zip(finite, read, kept, strict=True) if not _same(row[1], row[2])]
    assert differ == []


def test_a_file_that_validate_takes_is_stored_as_it_reads(kubectl: Kubectl, tmp_path: Path) -> None:
    taken = [(text, value) for text in TEXTS for value in _taken(f"- {text}")]
    found = stored(kubectl, tmp_path / "f.yaml", [f"p{n}: {text}" for n, (text, _) in enumerate(taken)])
    assert [found.get(f"p{n}") for n in range(len(taken))] == [value for _, value in taken]
    assert {"x", "1.5", "-1", "2024-01-01", "1:30", "192.0.2.1"} <= {text for text, _ in taken}
    assert {"y", "n", "on", "0777", "0b11", "1_000", "08"}.isdisjoint(text for text, _ in taken)


def test_a_key_that_validate_takes_is_stored_as_it_reads(kubectl: Kubectl, tmp_path: Path) -> None:
    taken = list(itertools.chain.from_iterable(_taken(f"{{? {text} : 1}}") for text in TEXTS))
    keys = [key for mapping in taken for key in mapping]
    found = stored(kubectl, tmp_path / "f.yaml", ["map:", *(f"  {key}: 1" for key in keys)])
    assert set(found["map"]) == set(keys)
    assert "x" in keys
    assert {"y", "n", "on", "0777", "1_000"}.isdisjoint(keys)


def _same(ours: object, theirs: object) -> bool:
    """Whether the server kept what was read; whole numbers that do not fit into 64 bits become floats there."""
    if isinstance(ours, int) and not -(2**63) <= ours < 2**63:
        return isinstance(theirs, int | float) and float(ours) == float(theirs)
    return ours == theirs and isinstance(ours, bool) == isinstance(theirs, bool)


def _endless(value: object) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _taken(text: str) -> list[Any]:
    """What is read of a list or a mapping with one entry; empty where it is refused."""
    try:
        found = thaw(parse(text))
    except YamlError:
        return []
    assert isinstance(found, list | dict)
    return found if isinstance(found, list) else [found]
