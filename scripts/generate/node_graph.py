"""The picture of the nodes in examples/sedia/README.md, drawn from its sources and its RobotOffload as Mermaid.

What a node publishes and hears is read from the calls in its class and the classes that it builds on; what goes through
the agents, and which actions a node calls, from the RobotOffload. Arrows follow the data: a topic from its publisher,
a goal from its client.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import Node

GRAPH_FILE: Final = "examples/sedia/README.md"
_BEGIN: Final = "<!-- nodes: drawn from the sources by `make generate`; changes between these lines are lost -->"
_END: Final = "<!-- end of nodes -->"
_PUBLISH: Final = ("create_publisher", "create_lifecycle_publisher")
_SERVE: Final = ("create_service", "serve")
_CALL: Final = ("create_client", "ActionClient")
_TITLES: Final = {"Robot": "on the robot", "Duplicated": "on both sides", "Cloud": "in the cloud"}
_UNSHOWN: Final = ("tf", "tf_static", "wheels_control/inhibit")
"""What everybody may hear, and what the agent calls."""


class NoPlaceError(ValueError):
    """The page has no lines between which the picture belongs."""


@dataclass
class Names:
    """What a class publishes, hears, serves and calls, without a leading slash."""

    publishes: set[str] = field(default_factory=set)
    hears: set[str] = field(default_factory=set)
    serves: set[str] = field(default_factory=set)
    calls: set[str] = field(default_factory=set)

    def add(self, other: Names) -> None:
        """Take in what another class does."""
        self.publishes |= other.publishes
        self.hears |= other.hears
        self.serves |= other.serves
        self.calls |= other.calls


def with_nodes(root: Path) -> str:
    """Return the page with the picture of today's nodes.

    Raises:
        NoPlaceError: the page lacks the two comment lines.
    """
    page = (root / GRAPH_FILE).read_text(encoding="utf-8")
    place = re.compile(f"{re.escape(_BEGIN)}.*?{re.escape(_END)}", re.DOTALL)
    if not place.search(page):
        raise NoPlaceError(f"{GRAPH_FILE}: write these two lines where the picture shall be: {_BEGIN} {_END}")
    drawn = "\n".join([_BEGIN, *_picture((root / GRAPH_FILE).parent), _END])
    return place.sub(lambda _: drawn, page)


def _picture(folder: Path) -> Iterator[str]:
    nodes = load(folder / "robotoffload.yaml").spec.nodes
    names = {node.name: _names(node, folder) for node in nodes}
    yield "```mermaid"
    yield "flowchart LR"
    for placement, title in _TITLES.items():
        yield f'  subgraph {placement}["{title}"]'
        yield from (f"    {node.name}" for node in nodes if node.placement == placement)
        yield "  end"
    for (source, target), labels in sorted(_arrows(names).items()):
        yield f'  {source} -->|"{", ".join(sorted(labels))}"| {target}'
    yield "```"


def _arrows(names: Mapping[str, Names]) -> Mapping[tuple[str, str], set[str]]:
    found: dict[tuple[str, str], set[str]] = {}
    for source, its in names.items():
        for target, other in names.items():
            labels = (its.publishes & other.hears | its.calls & other.serves) - set(_UNSHOWN)
            if labels and source != target:
                found[source, target] = labels
    return found


def _names(node: Node, folder: Path) -> Names:
    """Return what a node does, by its class and its entry in the RobotOffload."""
    nodes = ast.parse((folder / "sedia.py").read_text(encoding="utf-8"))
    table = next(
        it.value for it in ast.walk(nodes) if isinstance(it, ast.Assign) and ast.unparse(it.targets[0]) == "NODES"
    )
    known: dict[str, str] = ast.literal_eval(table)
    _, _, name = known[node.name].partition(":")
    found = _of_class(name, _classes(folder))
    found.publishes |= {output.topic.lstrip("/") for output in node.outputs}
    found.serves |= {it.name.lstrip("/") for it in node.offered}
    found.calls |= {it.name.lstrip("/") for it in node.called}
    return found


def _classes(folder: Path) -> dict[str, ast.ClassDef]:
    modules = (ast.parse(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.py")))
    return {it.name: it for module in modules for it in ast.walk(module) if isinstance(it, ast.ClassDef)}


def _of_class(name: str, classes: Mapping[str, ast.ClassDef]) -> Names:
    found = Names()
    definition = classes.get(name)
    if definition is None:
        return found
    for base in definition.bases:
        found.add(_of_class(ast.unparse(base), classes))
    loops = {
        ast.unparse(it.target): it.iter for it in ast.walk(definition) if isinstance(it, ast.For) and _plain(it.iter)
    }
    for call in (it for it in ast.walk(definition) if isinstance(it, ast.Call)):
        said = {word for argument in call.args for word in _words(argument, loops)}
        word = ast.unparse(call.func).rpartition(".")[2]
        for kind, into in (
            (_PUBLISH, found.publishes),
            (("create_subscription",), found.hears),
            (_SERVE, found.serves),
            (_CALL, found.calls),
        ):
            if word in kind:
                into.update(said)
    return found


def _words(argument: ast.expr, loops: Mapping[str, ast.expr]) -> set[str]:
    """Return the texts that an argument can be."""
    if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
        return {argument.value.lstrip("/")}
    if isinstance(argument, ast.Name) and argument.id in loops:
        return {str(word).lstrip("/") for word in ast.literal_eval(loops[argument.id])}
    return set()


def _plain(values: ast.expr) -> bool:
    return isinstance(values, ast.Tuple) and all(isinstance(it, ast.Constant) for it in values.elts)
