"""A sketch as YAML text for a person to read and edit: one line an entry, with its comment beside it."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1.robotoffload import API_VERSION, KIND
from robot_offload.survey.sketch import Entry, NodeSketch, Sketch

WIDTH: Final = 116
_PLAIN: Final = re.compile(r"[A-Za-z/_][A-Za-z0-9_/.~-]*|[0-9]+(ms|s|m|h|Mi)")
_WORDS: Final = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null", "~"})
"""Words that a reader of YAML 1.1 does not take for text."""


def written(sketch: Sketch) -> str:
    """Return the text of the whole file."""
    return "\n".join(line.rstrip() for line in _lines(sketch)) + "\n"


def _lines(sketch: Sketch) -> Iterator[str]:
    for line in sketch.head:
        yield from _comment(line, "")
    yield f"apiVersion: {API_VERSION}"
    yield f"kind: {KIND}"
    yield f"metadata: {{name: {flow(sketch.name)}}}"
    yield "spec:"
    for name, block in sketch.spec.items():
        if block and name != "switching":
            yield from _noted(f"  {name}: {flow(block)}", sketch.notes.get(name, ""), "  ")
    if sketch.to_cloud:
        yield "  topics:"
        yield "    toCloud:"
        yield from _entries(sketch.to_cloud, "    ")
    yield "  nodes:"
    for node in sketch.nodes:
        yield from _node(node)
    yield from _switching(sketch)
    for line in sketch.left_out:
        yield from _comment(line, "")


def _node(node: NodeSketch) -> Iterator[str]:
    for note in node.notes:
        yield from _comment(note, "  ")
    yield f"  - name: {flow(node.name)}"
    yield f"    placement: {node.placement}"
    for name, value in node.fields.items():
        yield f"    {name}: {flow(value)}"
    for name, entries in node.lists.items():
        if entries:
            yield f"    {name}:"
            yield from _entries(entries, "    ")
    if any(node.uses.values()):
        yield "    uses:"
        for name, entries in node.uses.items():
            if entries:
                yield f"      {name}:"
                yield from _entries(entries, "      ")


def _switching(sketch: Sketch) -> Iterator[str]:
    block = sketch.spec.get("switching", {})
    if not block and not sketch.silent:
        return
    yield from _comment(sketch.notes.get("switching", ""), "  ")
    yield "  switching:"
    for name, value in block.items():
        yield f"    {name}: {flow(value)}"
    if sketch.silent:
        yield "    silent:"
        for it in sketch.silent:
            yield from _noted(f"    - {flow(it.value['name'])}", it.note, "    ")


def _entries(entries: Sequence[Entry], indent: str) -> Iterator[str]:
    for entry in entries:
        yield from _noted(f"{indent}- {flow(entry.value)}", entry.note, indent)


def _noted(line: str, note: str, indent: str) -> Iterator[str]:
    if note and len(line) + len(note) + 4 <= WIDTH:
        yield f"{line}  # {note}"
        return
    yield from _comment(note, indent)
    yield line


def _comment(text: str, indent: str) -> Iterator[str]:
    for line in textwrap.wrap(text, WIDTH - len(indent) - 2, break_on_hyphens=False):
        yield f"{indent}# {line}"


def flow(value: Any) -> str:
    """Return a value in YAML's flow style."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{flow(key)}: {flow(it)}" for key, it in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(flow(it) for it in value) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    if isinstance(value, float):
        text = repr(value)
        return text if "e" not in text or "." in text else text.replace("e", ".0e")
    return json.dumps(value)
