"""The set-up script on machines with odd programs on PATH."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def bootstrap(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    sys.modules.pop("bootstrap", None)
    import bootstrap

    yield bootstrap
    sys.modules.pop("bootstrap", None)


def program(folder: Path, text: str) -> Path:
    path = folder / "uv"
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.mark.parametrize("text", ["#!/bin/sh\necho 'uv: command not found' >&2\nexit 127\n", "no program"])
def test_a_uv_that_does_not_run_is_passed_over(bootstrap, tmp_path, monkeypatch, text):
    program(tmp_path, text)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}/usr/bin{os.pathsep}/bin")
    assert bootstrap.uv_on_path() is None


def test_a_uv_that_runs_is_used(bootstrap, tmp_path, monkeypatch):
    uv = program(tmp_path, "#!/bin/sh\necho uv 0.13.8\n")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}/usr/bin{os.pathsep}/bin")
    assert bootstrap.uv_on_path() == str(uv)
