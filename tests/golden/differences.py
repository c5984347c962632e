"""The children of one sample as differences against the children of another, which is recorded whole."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from typing import Any

import yaml


class Dumper(yaml.SafeDumper):
    """Texts of several lines as blocks, nothing by reference."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style="|" if "\n" in value else None)


Dumper.add_representer(str, _text)


def dump(objects: list[dict[str, Any]]) -> str:
    """Return the objects as one YAML text."""
    return yaml.dump_all(objects, Dumper=Dumper, sort_keys=False, width=110)


def differences(objects: list[dict[str, Any]], name: str, whole: list[dict[str, Any]], whole_name: str) -> str:
    """Return what a reader of the whole has to know about the objects; `whole_name` is read as `name`.

    Each object stands against the one of its kind and role. Hunks are headed by the YAML keys above them and have no
    line numbers, so that a change of the whole that all samples share changes no other file.
    """
    rest = list(whole)
    lines = [f"# {whole_name}.yaml with the name {name}, and these differences"]
    for item in objects:
        own = f"{item['kind']} {item['metadata']['name']}"
        base = _counterpart(item, name, whole, whole_name)
        if base is None:
            lines += ["", f"+++ {own}: only here", *(f"+{line}" for line in _lines(item))]
            continue
        rest = [other for other in rest if other is not base]
        before = [re.sub(rf"\b{whole_name}\b", name, line) for line in _lines(base)]
        hunks = list(_hunks(before, _lines(item)))
        if hunks:
            lines += ["", f"--- {base['kind']} {base['metadata']['name']}", f"+++ {own}", *hunks]
        else:
            lines += ["", f"=== {own}"]
    lines += [f"\n--- {item['kind']} {item['metadata']['name']}: not here" for item in rest]
    return "\n".join(lines) + "\n"


def _lines(item: dict[str, Any]) -> list[str]:
    return dump([item]).splitlines()


def _counterpart(
    item: dict[str, Any], name: str, whole: list[dict[str, Any]], whole_name: str
) -> dict[str, Any] | None:
    """Return the object of the whole with the same kind and role; a node's Deployment stands against any node's."""

    def role(of: dict[str, Any], owner: str) -> str:
        component: str = of["metadata"]["labels"]["app.kubernetes.io/component"]
        return component if component == "node" else of["metadata"]["name"].removeprefix(owner)

    for other in whole:
        if other["kind"] == item["kind"] and role(other, whole_name) == role(item, name):
            return other
    return None


def _hunks(before: list[str], after: list[str]) -> Iterator[str]:
    matcher = difflib.SequenceMatcher(None, before, after, autojunk=False)
    for group in matcher.get_grouped_opcodes(1):
        yield f"@@ {_path(before, group[0][1])}".rstrip()
        for tag, start, end, new_start, new_end in group:
            if tag == "equal":
                yield from (f" {line}" for line in before[start:end])
                continue
            yield from (f"-{line}" for line in before[start:end])
            yield from (f"+{line}" for line in after[new_start:new_end])


def _path(lines: list[str], at: int) -> str:
    """Return the keys that enclose a line, from the outside in."""
    keys: list[str] = []
    depth = _depth(lines[at])
    for line in reversed(lines[:at]):
        if line.strip() and _depth(line) < depth:
            depth = _depth(line)
            keys.insert(0, line.strip().removeprefix("- ").partition(":")[0])
    return ".".join(keys)


def _depth(line: str) -> int:
    """Return the indentation of a line; an item of a list lies deeper than the key of the list."""
    stripped = line.lstrip()
    return 2 * (len(line) - len(stripped)) + stripped.startswith("- ")
