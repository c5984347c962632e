"""The tunnel's file: everything in it is checked before anything is opened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.tunnel.configuration import Address, parse, read
from robot_offload_core.fence.token import Site

GOOD: dict[str, Any] = {
    "side": "robot",
    "listen": "127.0.0.1:11667",
    "connect": ["203.0.113.5:11666", "[2001:db8::1]:11666", "edge.example.com:443"],
    "ca": "ca.pem",
    "certificate": "robot.pem",
    "private_key": "robot.key",
}


def test_addresses_of_both_families_and_names_are_read() -> None:
    found = parse(GOOD)
    assert found.side is Site.ROBOT
    assert found.connect == (
        Address("203.0.113.5", 11666),
        Address("2001:db8::1", 11666),
        Address("edge.example.com", 443),
    )
    assert [one.is_name for one in found.connect] == [False, False, True]
    assert [str(one) for one in found.connect] == GOOD["connect"]
    assert not found.verify_name
    assert not found.realtime


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("side", "ship", "side"),
        ("listen", "127.0.0.1", "listen"),
        ("listen", "127.0.0.1:0", "listen"),
        ("connect", [], "connect"),
        ("connect", "203.0.113.5:1", "connect"),
        ("connect", [5], "connect"),
        ("ca", "", "ca"),
        ("private_key", None, "private_key"),
        ("verify_name", "yes", "verify_name"),
        ("conect", [], "conect"),
    ],
)
def test_what_cannot_work_is_named(key: str, value: Any, named: str) -> None:
    with pytest.raises(ConfigurationError, match=named):
        parse({**GOOD, key: value})


@pytest.mark.parametrize("text", ["", "[]", "a: [", "\x00"])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "tunnel.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError):
        read(tmp_path / "tunnel.yaml")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"tunnel\.yaml"):
        read(tmp_path / "tunnel.yaml")
