"""Makes a sketch acceptable to `validate`: what a rule refuses is removed, and a comment says so.

The rules are the resource's own: the sketch is read like a file, and each problem gives the place of what goes.
"""

from __future__ import annotations

import re
from typing import Final

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.errors import SpecError
from robot_offload.findings import Finding
from robot_offload.survey.proposal import SurveyError
from robot_offload.survey.sketch import LISTS, Entry, Sketch, plain

ROUNDS: Final = 200
"""Each round removes something; a sketch of a robot needs a few."""
MOST: Final = {"outputs": 16, "services": 16, "actions": 16, "state": 8}
MOST_TO_CLOUD: Final = 128
MOST_SILENT: Final = 64
_NODE: Final = re.compile(r"spec\.nodes\[(\d+)\](?:\.(.*))?")
_ENTRY: Final = re.compile(r"(?:uses\.)?(\w+)(?:\[(\d+)\])?.*")


def fitted(sketch: Sketch) -> Sketch:
    """Return the sketch without what the resource refuses (it is changed in place).

    Raises:
        SurveyError: nothing is left of it.
    """
    _cut(sketch)
    for _ in range(ROUNDS):
        try:
            parse_object(sketch.values(), "proposal")
        except SpecError as error:
            for finding in sorted(error.findings, key=_last_first):
                _remove(sketch, finding)
        else:
            return sketch
        if not sketch.nodes:
            break
    raise SurveyError(f"nothing of this graph fits a RobotOffload: {' '.join(sketch.left_out[-3:])}")


def _cut(sketch: Sketch) -> None:
    for node in sketch.nodes:
        for name in LISTS:
            _shorten(sketch, node.lists[name], MOST[name], f"{name} of {plain(node.name)}")
        for name, entries in node.uses.items():
            _shorten(sketch, entries, MOST[name], f"used {name} of {plain(node.name)}")
    _shorten(sketch, sketch.to_cloud, MOST_TO_CLOUD, "topics to the cloud")
    _shorten(sketch, sketch.silent, MOST_SILENT, "silent topics; write groups such as local_costmap/**")


def _shorten(sketch: Sketch, entries: list[Entry], most: int, what: str) -> None:
    if len(entries) > most:
        names = ", ".join(plain(str(it.value.get("name") or it.value.get("topic"))) for it in entries[most:][:8])
        sketch.left_out.append(f"Left out, at most {most} {what}: {names} and so on ({len(entries) - most}).")
        del entries[most:]


def _last_first(finding: Finding) -> tuple[int, ...]:
    return tuple(-int(number) for number in re.findall(r"\[(\d+)\]", finding.path))


def _remove(sketch: Sketch, finding: Finding) -> None:
    """Remove what a finding is about; it may already be gone."""
    if node := _NODE.fullmatch(finding.path):
        _remove_of_node(sketch, int(node[1]), node[2] or "", finding)
    elif entry := re.match(r"spec\.topics\.toCloud(?:\[(\d+)\])?", finding.path):
        _drop(sketch, sketch.to_cloud, entry[1], finding)
    elif entry := re.match(r"spec\.switching\.silent(?:\[(\d+)\])?", finding.path):
        _drop(sketch, sketch.silent, entry[1], finding)
    elif finding.path.startswith("metadata"):
        sketch.name = "robot"
    elif (block := finding.path.removeprefix("spec.").partition(".")[0]) in sketch.spec:
        field = finding.path.removeprefix(f"spec.{block}.").partition(".")[0]
        if sketch.spec[block].pop(field, None) is None:
            sketch.spec[block] = {}
        _say(sketch, block, finding)
    elif sketch.nodes:
        sketch.nodes.pop()
        _say(sketch, "the last node", finding)


def _remove_of_node(sketch: Sketch, at: int, rest: str, finding: Finding) -> None:
    if at >= len(sketch.nodes):
        return
    node = sketch.nodes[at]
    part = _ENTRY.fullmatch(rest)
    name = part[1] if part else ""
    lists = node.uses if rest.startswith("uses.") else node.lists
    if part and name in lists:
        _drop(sketch, lists[name], part[2], finding)
    elif rest.startswith("uses"):
        node.uses = {"services": [], "actions": []}
        _say(sketch, plain(node.name), finding)
    elif name in node.fields and name != "lifecycle":
        del node.fields[name]
        _say(sketch, plain(node.name), finding)
    else:
        del sketch.nodes[at]
        _say(sketch, plain(node.name), finding)


def _drop(sketch: Sketch, entries: list[Entry], at: str | None, finding: Finding) -> None:
    if at is None:
        entries.clear()
        _say(sketch, finding.path, finding)
    elif int(at) < len(entries):
        gone = entries.pop(int(at))
        _say(sketch, plain(str(gone.value.get("name") or gone.value.get("topic") or gone.value)), finding)


def _say(sketch: Sketch, what: str, finding: Finding) -> None:
    line = f"Left out: {what}: {plain(finding.message)}"
    if line not in sketch.left_out:
        sketch.left_out.append(line)
