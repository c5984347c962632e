"""docs/benchmarks.md and its pictures: one section for each group of figures, each with its own date.

What the page was made of is kept beside it (`benchmarks.json`), so that a run replaces only what it has measured. A
group has room for a short and for a long form: what was measured at length stays until it is measured at length again.
"""

from __future__ import annotations

import json
import string
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import jinja2

from robot_offload.errors import InputError
from robot_offload_lab.bench import machine, pictures, results, table
from robot_offload_lab.bench.plan import Form
from robot_offload_lab.bench.results import PRIORITIES, Distribution, Figure, GroupResult, Priority
from robot_offload_lab.bench.store import Kept

PAGE: Final = "benchmarks.md"
SOURCE: Final = "benchmarks.json"
IMAGES: Final = "images"
SCHEMA: Final = "robotoffload.dev/bench-page/v1"
FORMS: Final[dict[Form, str]] = {"long": "long form", "short": "short form"}
CHAPTERS: Final = (
    ("latency", "Latency", ("experiment",)),
    ("lifecycle", "Lifecycle", ("lifecycle",)),
    ("switch", "Switching", ("commanded", "cuts", "alarms", "latency", "resources")),
    ("detect", "Detection", ("detect",)),
    ("collector", "Collector", ("collector",)),
    ("handover", "Handover", ("handover", "loaded", "mirrored", "keeping")),
    ("hot", "Hot standby", ("hot", "silence")),
)
"""Command, title, groups: the order of the page."""


@dataclass(frozen=True)
class Section:
    """One group, measured with one priority in one form.

    Attributes:
        date: of the measurement. load: of the machine before and after.
        machine: see `machine.words`.
    """

    group: str
    priority: Priority
    form: Form
    date: str
    machine: str
    load: tuple[float, float]
    figures: tuple[Figure, ...]
    parts: tuple[Distribution, ...]

    @property
    def key(self) -> tuple[str, str, str]:
        """Two sections with the same key are the same section, measured twice."""
        return self.group, self.form, self.priority

    @property
    def heading(self) -> str:
        """What it is, and when."""
        return f"{FORMS[self.form].capitalize()}, {table.PRIORITY_WORDS[self.priority]}, {self.date}"


def write(kept: Sequence[Kept], docs: Path) -> Path:
    """Writes the page and its pictures; returns the page's path.

    Raises:
        InputError: what the page was made of cannot be read.
        OSError: the folder cannot be written.
    """
    images = docs / IMAGES
    images.mkdir(parents=True, exist_ok=True)
    for form in FORMS:
        alike = [one for one in kept if one.amounts.form == form]
        for name, picture in pictures.draw([one.outcome for one in alike], notes(alike)).items():
            (images / _file(name, form)).write_bytes(picture.png)
    sections = merged(read(docs), [section(one) for one in kept])
    (docs / SOURCE).write_text(encode(sections), encoding="utf-8")
    there = {path.name for path in images.glob("bench-*.png")}
    path = docs / PAGE
    path.write_text(text(sections, there), encoding="utf-8")
    return path


def section(one: Kept) -> Section:
    """Returns what the page keeps of a measurement."""
    outcome = one.outcome
    return Section(
        outcome.group, outcome.priority, one.amounts.form, one.date, machine.words(one.machine), one.load,
        outcome.figures, outcome.parts,
    )  # fmt: skip


def notes(kept: Sequence[Kept]) -> dict[str, str]:
    """Group -> when, on what and beside what load it was measured, for its pictures."""
    found: dict[str, list[str]] = {}
    for one in kept:
        before, after = one.load
        words = f"{one.date}, load {before:.1f} / {after:.1f}, {machine.words(one.machine)}"
        known = found.setdefault(one.outcome.group, [])
        if words not in known:
            known.append(words)
    return {group: "\n".join(lines) for group, lines in found.items()}


def merged(old: Sequence[Section], new: Sequence[Section]) -> tuple[Section, ...]:
    """Returns the new ones in the place of the old ones with the same key, in the order of the page."""
    by_key = {one.key: one for one in (*old, *new)}
    groups = [group for _, _, groups in CHAPTERS for group in groups]
    order = [(group, form, priority) for group in groups for form in FORMS for priority in PRIORITIES]
    return tuple(by_key[key] for key in order if key in by_key)


# -- what the page was made of ----------------------------------------------------------------------------------------


def read(docs: Path) -> tuple[Section, ...]:
    """Returns the sections of the page as it stands; none when there is no page.

    Raises:
        InputError: the file is damaged or of another kind.
    """
    path = docs / SOURCE
    if not path.exists():
        return ()
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["schema"] != SCHEMA:
            raise InputError(f"{path}: has the schema {document['schema']!r}, not {SCHEMA!r}; restore it")
        return tuple(_decoded(values) for values in document["sections"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: cannot be read: {error}; restore it, or remove it to begin anew") from error


def encode(sections: Sequence[Section]) -> str:
    """Returns the file."""
    return json.dumps({"schema": SCHEMA, "sections": [_encoded(one) for one in sections]}, indent=1) + "\n"


def _encoded(one: Section) -> dict[str, Any]:
    values = results.to_json(GroupResult(one.group, one.priority, one.figures, one.parts, ()))
    return {**asdict(one), **values}


def _decoded(values: Mapping[str, Any]) -> Section:
    outcome = results.from_json(values["group"], values["priority"], values)
    before, after = values["load"]
    return Section(
        values["group"], values["priority"], values["form"], values["date"], values["machine"], (before, after),
        outcome.figures, outcome.parts,
    )  # fmt: skip


# -- the page ---------------------------------------------------------------------------------------------------------


def text(sections: Sequence[Section], images: set[str]) -> str:
    """Returns the page; `images` are the files of pictures that there are."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robot_offload_lab.bench"),
        autoescape=False,  # noqa: S701 - Markdown, and nothing in it comes from outside
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(
        number=table.number, link=table.link, verdict=table.verdict, limit=table.limit, beside=table.beside,
        ratio=table.ratio,
    )  # fmt: skip
    return environment.get_template("benchmarks.md.j2").render(
        chapters=list(_chapters(sections, images)),
        machines=dict(zip(dict.fromkeys(one.machine for one in sections), string.ascii_uppercase, strict=False)),
        titles=table.TITLES,
        priorities=table.PRIORITY_WORDS,
        forms=FORMS,
        sections=sections,
    )


def _chapters(sections: Sequence[Section], images: set[str]) -> Iterator[dict[str, Any]]:
    for command, title, groups in CHAPTERS:
        blocks = []
        for group in groups:
            there = [one for one in sections if one.group == group]
            if there:
                blocks.append({"group": group, "sections": there, "pictures": list(_pictures(group, there, images))})
        if blocks:
            yield {"command": command, "title": title, "blocks": blocks}


def _pictures(group: str, there: Sequence[Section], images: set[str]) -> Iterator[tuple[str, str]]:
    for form in FORMS:
        if any(one.form == form for one in there):
            for name, caption in pictures.CAPTIONS.items():
                file = _file(name, form)
                if name.removesuffix(pictures.SPREAD) == f"bench-{group}" and file in images:
                    yield f"{IMAGES}/{file}", f"{caption} ({FORMS[form]})"


def _file(name: str, form: Form) -> str:
    return f"{name}.png" if form == "long" else f"{name}-short.png"
