"""The picture of the rooms in docs/architecture.md, drawn from the imports as Mermaid.

A room is a package's sub-package; modules beside the rooms are left out. An arrow points at what a room imports. Arrows
that follow from others are left out (a room that reaches another one through a third): what remains is the order.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Set
from typing import Final

import grimp

ARCHITECTURE_FILE: Final = "docs/architecture.md"
PACKAGES: Final = (
    "robot_offload_lab",
    "robot_offload_sim",
    "robot_offload_agent",
    "robot_offload",
    "robot_offload_core",
)
_BEGIN: Final = "<!-- rooms: drawn from the imports by `make generate`; changes between these lines are lost -->"
_END: Final = "<!-- end of rooms -->"
Arrows = Mapping[str, Set[str]]


class NoPlaceError(ValueError):
    """The page has no lines between which the picture belongs."""


def with_rooms(page: str) -> str:
    """Return the page with the picture of today's imports.

    Raises:
        NoPlaceError: the page lacks the two comment lines.
    """
    place = re.compile(f"{re.escape(_BEGIN)}.*?{re.escape(_END)}", re.DOTALL)
    if not place.search(page):
        raise NoPlaceError(f"{ARCHITECTURE_FILE}: write these two lines where the picture shall be: {_BEGIN} {_END}")
    drawn = "\n".join([_BEGIN, *_pictures(), _END])
    return place.sub(lambda _: drawn, page)


def _pictures() -> Iterator[str]:
    """Yield the lines of one picture of the packages and one for each package's rooms."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    imports = [
        (source, target) for source in graph.modules for target in graph.find_modules_directly_imported_by(source)
    ]
    yield from _picture("The packages", _reduced(_arrows(imports, depth=1)))
    for package in PACKAGES:
        rooms = {room for room in graph.find_children(package) if graph.find_children(room)}
        inside = [(a, b) for a, b in imports if _room(a) in rooms and _room(b) in rooms]
        yield from _picture(f"The rooms of `{package}`", _reduced(_arrows(inside, depth=2)))


def _room(module: str) -> str:
    """Return the first two parts of a module's name: package and room."""
    return ".".join(module.split(".")[:2])


def _arrows(imports: list[tuple[str, str]], depth: int) -> Arrows:
    """Return room -> rooms it imports; a room is named by the first `depth` parts of a module's name."""
    arrows: dict[str, set[str]] = {}
    for source, target in imports:
        here, there = (".".join(module.split(".")[:depth]) for module in (source, target))
        arrows.setdefault(here, set())
        arrows.setdefault(there, set())
        if here != there:
            arrows[here].add(there)
    return arrows


def _reduced(arrows: Arrows) -> Arrows:
    """Return the arrows without those that follow from others. The import contracts see to it that none goes round."""
    return {
        room: {there for there in targets if not any(there in _reach(arrows, other) for other in targets - {there})}
        for room, targets in arrows.items()
    }


def _reach(arrows: Arrows, room: str) -> set[str]:
    """Return everything that a room imports, directly or not."""
    found: set[str] = set()
    waiting = [room]
    while waiting:
        for there in arrows[waiting.pop()] - found:
            found.add(there)
            waiting.append(there)
    return found


def _picture(title: str, arrows: Arrows) -> Iterator[str]:
    """Yield the lines of one Mermaid picture."""
    yield from ("", f"{title}:", "", "```mermaid", "flowchart TD")
    names = {room: room.rpartition(".")[2] for room in arrows}
    for room in sorted(arrows, key=names.__getitem__):
        yield f"    {_id(names[room])}[{names[room]}]"
    for room in sorted(arrows, key=names.__getitem__):
        if arrows[room]:
            yield f"    {_id(names[room])} --> {' & '.join(sorted(_id(names[there]) for there in arrows[room]))}"
    yield "```"


def _id(name: str) -> str:
    """Return a name that is no word of Mermaid's own (`link`, `graph`, `end` are)."""
    return f"room_{name}"
