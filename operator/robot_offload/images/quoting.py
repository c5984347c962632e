"""The only ways for a value into a Dockerfile: one filter for each kind of place."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from typing import Final


def shell(value: str) -> str:
    """Return one word of a shell command."""
    return shlex.quote(_one_line(value))


def shell_words(values: Iterable[str]) -> str:
    """Return several words of a shell command."""
    return " ".join(shell(value) for value in values)


def quoted(value: str) -> str:
    r"""Return the value of a LABEL or ENV instruction in double quotes; `\`, `"` and `$` are escaped."""
    escaped = _one_line(value).replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$")
    return f'"{escaped}"'


def array(values: Iterable[str]) -> str:
    """Return the JSON form of ENTRYPOINT, CMD or COPY, which no shell reads."""
    return json.dumps([_one_line(value) for value in values], ensure_ascii=False)


def file_lines(text: str, indent: int = 4) -> str:
    r"""Return a small file as arguments of `printf '%s\n'`, one line each; some builders cannot read here-documents."""
    quoted_lines = ("'" + line.replace("'", "'\"'\"'") + "'" for line in text.splitlines())
    return f" \\\n{' ' * indent}".join(quoted_lines)


def _one_line(value: str) -> str:
    """Return `value`, already checked by the types of `values`: a second line would be a second instruction."""
    if "\n" in value or "\r" in value:
        raise ValueError("a value of a Dockerfile has more than one line")
    return value


FILTERS: Final = {
    "shell": shell,
    "shell_words": shell_words,
    "quoted": quoted,
    "array": array,
    "file_lines": file_lines,
}
