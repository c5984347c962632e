"""Picks the pins of some packages, and of what these need, out of all: pins.py REQUIREMENTS NAME|PYPROJECT.TOML...

Of a pyproject.toml an extra counts as well when its name follows in brackets: pyproject.toml[operator].
REQUIREMENTS is a file with hashes that notes who needs what (`# via`), as uv and pip-tools write it. Runs inside the
builds of our own images, with nothing but Python: an image gets what it needs, at the versions that were tested.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path

_BLOCK = re.compile(r"^([A-Za-z0-9_.-]+)==.*\n(?:[ \t].*\n)*", re.MULTILINE)
_VIA = re.compile(r"^\s+#\s+(?:via\s+)?([a-z0-9][a-z0-9._-]*)$", re.MULTILINE)


def chosen(requirements: str, roots: Iterable[str]) -> str:
    """Return the blocks of `roots` and of everything they need.

    Raises:
        KeyError: a root is not pinned.
    """
    blocks = {match[1]: match[0] for match in _BLOCK.finditer(requirements)}
    users = {name: {user for user in _VIA.findall(block) if user != "via"} for name, block in blocks.items()}
    names = set(roots)
    size = 0
    while size != len(names):
        size = len(names)
        names |= {name for name, via in users.items() if via & names}
    return "".join(blocks[name] for name in sorted(names))


def dependencies(text: str, extra: str = "") -> tuple[str, ...]:
    """Return what the text of a `pyproject.toml` needs, by name; our own packages have no pins.

    Args:
        text: of the file.
        extra: an extra whose needs are added; empty: none.

    Raises:
        KeyError: the file has no such extra.
    """
    import tomllib  # noqa: PLC0415 - not in the Python of older bases, which name their packages

    project = tomllib.loads(text)["project"]
    found = [*project["dependencies"], *(project["optional-dependencies"][extra] if extra else ())]
    names = (re.split(r"[\s\[<>=!~;]", dependency, maxsplit=1)[0].lower() for dependency in found)
    return tuple(name for name in names if not name.startswith("robot-offload"))


def main() -> int:
    """Print the pins."""
    requirements, *roots = sys.argv[1:]
    names: list[str] = []
    try:
        for root in roots:
            file, _, extra = root.rstrip("]").partition("[")
            names += dependencies(Path(file).read_text(encoding="utf-8"), extra) if file.endswith(".toml") else [root]
        sys.stdout.write(chosen(Path(requirements).read_text(encoding="utf-8"), names))
    except KeyError as error:
        sys.stderr.write(f"{requirements} does not pin {error}; resolve it anew with `make pins`\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
