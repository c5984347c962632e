"""A robot without the library: one sentence, and no end."""

import importlib.util

import pytest

from robot_offload_agent import main
from robot_offload_agent.errors import StartError
from robot_offload_agent.record.mcap import mcap_file


def test_an_agent_without_the_library_says_so_and_starts_no_recorder(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert main.recorder() == {}
    assert "pip install 'robot-offload-agent[record]'" in caplog.text


def test_with_the_library_there_is_one() -> None:
    assert list(main.recorder()) == ["record"]


def test_the_command_without_the_library_names_the_next_step(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> None:
        raise ImportError

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(StartError, match="pip install"):
        mcap_file.library()
