"""NO_PROXY as kubectl reads it: names, suffixes, addresses and networks."""

from __future__ import annotations

import pytest

from robot_offload.kube.proxies import wanted


@pytest.mark.parametrize(
    ("host", "exceptions", "through_proxy"),
    [
        ("10.96.0.1", "10.96.0.0/12", False),
        ("10.96.0.1", "192.168.0.0/16,.svc, 10.0.0.0/8", False),
        ("127.0.0.1", "127.0.0.1", False),
        ("fd00::1", "fd00::/8", False),
        ("fd00::1", "10.0.0.0/8", True),
        ("11.0.0.1", "10.0.0.0/8", True),
        ("kubernetes.default.svc", ".svc", False),
        ("api.example", "10.0.0.0/8", True),
        ("api.example", "*", False),
        ("10.96.0.1", "10.96.0.0/99, nonsense/8", True),
        ("10.96.0.1", "", True),
    ],
)
def test_networks_count_as_names_do(
    host: str, exceptions: str, through_proxy: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY", "no_proxy", "https_proxy"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HTTPS_PROXY", "http://proxy.example:3128")
    monkeypatch.setenv("NO_PROXY", exceptions)
    assert wanted(host) == through_proxy


def test_without_a_proxy_none_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("NO_PROXY", "10.0.0.0/8")
    assert not wanted("11.0.0.1")
