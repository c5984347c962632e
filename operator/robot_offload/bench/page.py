"""docs/benchmarks.md and its pictures, from what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import jinja2

from robot_offload.bench import pictures, table
from robot_offload.bench.results import PRIORITIES, Figure, Part, Priority
from robot_offload.bench.store import Kept

PAGE: Final = "benchmarks.md"
IMAGES: Final = "images"
_TITLES: Final = {
    "commanded": "Commanded switches",
    "cuts": "Sudden cuts",
    "alarms": "False alarms",
    "latency": "Added latency",
    "resources": "Cost on the robot",
}


@dataclass(frozen=True)
class Section:
    """The parts of the figures of one group and priority."""

    title: str
    parts: tuple[Part, ...]


def write(kept: Sequence[Kept], docs: Path) -> Path:
    """Writes the page and its pictures; returns the page's path.

    Raises:
        OSError: the folder cannot be written.
    """
    images = docs / IMAGES
    images.mkdir(parents=True, exist_ok=True)
    drawn = pictures.draw([one.outcome for one in kept])
    for name, picture in drawn.items():
        (images / f"{name}.png").write_bytes(picture.png)
    path = docs / PAGE
    path.write_text(text(kept, drawn), encoding="utf-8")
    return path


def text(kept: Sequence[Kept], drawn: dict[str, pictures.Picture]) -> str:
    """The page."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robot_offload.bench"),
        autoescape=False,  # noqa: S701 - Markdown, and nothing in it comes from outside
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(number=table.number, link=table.link, verdict=table.verdict, limit=table.limit)
    return environment.get_template("benchmarks.md.j2").render(
        kept=kept,
        machines=_machines(kept),
        tables={table.PRIORITY_WORDS[p]: _figures(kept, p) for p in PRIORITIES if _figures(kept, p)},
        sections=_sections(kept),
        pictures={f"{IMAGES}/{name}.png": picture.caption for name, picture in drawn.items()},
        titles=_TITLES,
        priorities=table.PRIORITY_WORDS,
    )


def _figures(kept: Sequence[Kept], priority: Priority) -> tuple[Figure, ...]:
    return table.figures([one.outcome for one in kept], priority)


def _machines(kept: Sequence[Kept]) -> list[str]:
    """Every class of machine that was measured on, once."""
    found = []
    for one in kept:
        known = one.machine
        versions = ", ".join(f"{name} {version}" for name, version in known["versions"].items())
        found.append(
            f"{known['cores']} cores ({known['processor']}), {known['memory_gb']} GB, {known['system']}, "
            f"Python {known['python']}, {versions}"
        )
    return list(dict.fromkeys(found))


def _sections(kept: Sequence[Kept]) -> list[Section]:
    return [
        Section(f"{_TITLES[one.outcome.group]}, {table.PRIORITY_WORDS[one.outcome.priority]}", one.outcome.parts)
        for one in kept
        if one.outcome.parts
    ]
