"""Writes all golden Dockerfiles anew; look at the difference before you commit it."""

from __future__ import annotations

from tests.golden.dockerfiles.cases import CASES, generated, golden_path

for case in CASES:
    golden_path(case).write_text(generated(case), encoding="utf-8")
