"""Check commit messages: an imperative subject of at most 60 characters, and a body of two sentences that says why.

`python -m scripts.commit_messages FILE` checks the message that git is about to commit (a hook of stage commit-msg).
`python -m scripts.commit_messages` checks every commit since the rule exists. A clone without that history passes.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

BASE: Final = "9d85a0a80939e9494e565955e80cad654b437189"
"""The last commit before the rule."""
MAX_SUBJECT: Final = 60
MIN_SENTENCES: Final = 2
_NOT_IMPERATIVE: Final = re.compile(
    r"(the|an?|this|these|it|there|what|(?!bring\b)\w{2,}ing|(?!embed\b)\w+[^e]ed)\b", re.IGNORECASE
)
_SENTENCE_END: Final = re.compile(r"[.!?][)\"'`]*(?=\s|$)")
_COMMENT: Final = re.compile(r"^#.*\n?", re.MULTILINE)
_SCISSORS: Final = "# ------------------------ >8 ------------------------"
_WRITTEN_BY_GIT: Final = ("Merge ", "Revert ", "fixup! ", "squash! ", "amend! ")


def problems(message: str) -> Iterator[str]:
    """Yield what is wrong with a commit message, a sentence each; nothing for messages that git writes itself."""
    text = _COMMENT.sub("", message.partition(_SCISSORS)[0]).strip()
    subject, _, rest = text.partition("\n")
    if subject.startswith(_WRITTEN_BY_GIT):
        return
    if not subject:
        yield "the message is empty; write an imperative subject, an empty line, and two sentences that say why"
        return
    if len(subject) > MAX_SUBJECT:
        yield f"the subject has {len(subject)} characters; write at most {MAX_SUBJECT}"
    if subject.endswith("."):
        yield "the subject ends with a full stop; leave it out"
    first = subject.rpartition(": ")[2]
    if _NOT_IMPERATIVE.match(first):
        yield f"the subject begins with {first.split()[0]!r}; begin with an imperative, for example 'Add' or 'Refuse'"
    lines = rest.split("\n")
    if rest and lines[0].strip():
        yield "the second line is not empty; leave a line free between subject and body"
    if len(_SENTENCE_END.findall(rest)) < MIN_SENTENCES:
        yield f"the body has fewer than {MIN_SENTENCES} sentences; say why the change is made"


def main(arguments: Sequence[str]) -> int:
    """Check a file, or all commits since the rule; return 1 if a message breaks it."""
    given = [("commit message", Path(name).read_text(encoding="utf-8")) for name in arguments[:1]]
    found = dict(given or _commits())
    wrong = [f"{name}: {problem}" for name, message in found.items() for problem in problems(message)]
    for line in wrong:
        print(line, file=sys.stderr)  # noqa: T201
    return 1 if wrong else 0


def _commits() -> Iterator[tuple[str, str]]:
    """Yield (short hash and subject, message) of the commits since the rule; none where that history is missing."""
    if _git("merge-base", "--is-ancestor", BASE, "HEAD") is None:
        print(f"Commit messages not checked: {BASE[:7]} is not in this clone's history", file=sys.stderr)  # noqa: T201
        return
    for entry in (_git("log", "-z", "--no-merges", "--format=%H%n%B", f"{BASE}..HEAD") or "").split("\0"):
        name, _, message = entry.partition("\n")
        if name:
            yield f"{name[:7]} {message.partition(chr(10))[0]!r}", message


def _git(*arguments: str) -> str | None:
    """Return what git prints, or None if it fails or is not there."""
    try:
        done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout if done.returncode == 0 else None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
