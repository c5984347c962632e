"""Golden files: what a person has looked at and committed. `make golden` writes all of them anew."""

from __future__ import annotations

import os
from pathlib import Path

REWRITING = os.environ.get("UPDATE_GOLDEN") == "1"


def compare(file: Path, text: str) -> None:
    """Holds a text to its golden file, or writes the file if golden files are being rewritten."""
    if REWRITING:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    assert file.exists(), f"{file} is missing: run `make golden`, look at the difference, commit it"
    wanted = file.read_text(encoding="utf-8")
    assert text == wanted, f"{file.name} has changed: if that is meant, run `make golden` and look at the difference"
