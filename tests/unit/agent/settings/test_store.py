"""Settings kept on the robot's disk, the files of the cloud's pod, and what damage does to them: nothing."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from robot_offload_agent.settings import files, store
from robot_offload_agent.settings.cluster_files import RENEW_S, ClusterFiles
from robot_offload_agent.settings.files import Watch, read_text, write_whole
from robot_offload_agent.settings.liaison import LEAVING_S, Event, HandoverAsked, SettingsRead
from robot_offload_agent.settings.offer import Offer
from robot_offload_agent.settings.parameters import Configuration, parse

OFFER = Offer(4, {"pin": "Robot"})


def local(folder: Path, **different: Any) -> Configuration:
    return parse({"side": "robot", "uid": "walker-1", "state_dir": str(folder / "state"), "generation": 3, **different})


def test_what_was_kept_is_in_force_at_the_next_start(tmp_path: Path) -> None:
    store.keep(local(tmp_path), OFFER)
    configuration, offer, problem = store.load(local(tmp_path))
    assert (configuration["pin"], configuration["generation"]) == ("Robot", 4)
    assert (offer, problem) == (OFFER, None)
    assert store.in_force(local(tmp_path))["pin"] == "Robot"


def test_without_a_kept_file_the_robots_own_file_is_in_force(tmp_path: Path) -> None:
    assert store.load(local(tmp_path)) == (local(tmp_path), None, None)


def test_in_the_cloud_nothing_kept_is_in_force(tmp_path: Path) -> None:
    store.keep(local(tmp_path), OFFER)
    assert store.in_force(local(tmp_path, side="cloud"))["pin"] == "Auto"


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", "{}", '{"version": 2}', "\xff", "[" * 100_000,
        '{"version": 1, "uid": "walker-2", "generation": 4, "parameters": {}}',
        '{"version": 1, "uid": "walker-1", "generation": "4", "parameters": {}}',
        '{"version": 1, "uid": "walker-1", "generation": 4, "parameters": []}',
    ],
    ids=range(11),
)  # fmt: skip
def test_a_damaged_file_is_told_and_left_out(tmp_path: Path, text: str) -> None:
    path = store.path(local(tmp_path))
    path.parent.mkdir()
    path.write_bytes(text.encode("latin-1"))
    configuration, offer, problem = store.load(local(tmp_path))
    assert (configuration, offer) == (local(tmp_path), None)
    assert problem is not None
    assert problem[0] == "KeptSettingsDamaged"


def test_what_a_new_bundle_does_not_allow_any_more_is_told_and_left_out(tmp_path: Path) -> None:
    store.keep(local(tmp_path), Offer(4, {"lease_ms": 240.0}))
    stricter = local(tmp_path, lease_ms=200.0, loss_timeout_ms=60.0)
    configuration, _, problem = store.load(stricter)
    assert configuration == stricter
    assert problem is not None
    assert problem[0] == "KeptSettingsRefused"
    assert "HardLimit" in problem[1]


def test_a_newer_bundle_outweighs_what_was_kept_before(tmp_path: Path) -> None:
    store.keep(local(tmp_path), OFFER)
    newer = local(tmp_path, generation=5)
    assert store.load(newer) == (newer, None, None)


def test_what_cannot_be_kept_leaves_the_old_text(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    write_whole(path, "old", durable=True)
    (tmp_path / "state.json.part").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_whole(path, "new")
    assert read_text(path) == "old"


# -- watching


def looks(path: Path) -> tuple[Watch, list[tuple[str | None, str]]]:
    seen: list[tuple[str | None, str]] = []
    return Watch(path, lambda text, why: seen.append((text, why))), seen


def test_a_watched_file_is_told_once_for_each_change_also_through_an_exchanged_link(tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).write_text(name)
    link = tmp_path / "settings.yaml"
    link.symlink_to("first")
    watch, seen = looks(link)
    watch.look()
    watch.look()
    exchanged = tmp_path / "exchanged"
    exchanged.symlink_to("second")
    exchanged.replace(link)
    watch.look()
    assert [text for text, _ in seen] == ["first", "second"]


@pytest.mark.parametrize("content", [b"\xff", b"x" * (files.TEXT_BYTES + 1), None])
def test_a_watched_file_that_cannot_be_read_is_told_once(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "settings.yaml"
    if content is not None:
        path.write_bytes(content)
    watch, seen = looks(path)
    watch.look()
    watch.look()
    ((text, why),) = seen
    assert text is None
    assert str(path) in why


def happened(folder: Path, name: str, text: str, age_s: float = 0.0) -> list[Event]:
    """What a change of one of the cloud's files leads to."""
    path = folder / name
    path.write_text(text)
    written_s = path.stat().st_mtime - age_s
    os.utime(path, (written_s, written_s))
    given = {f"{word}_file": str(folder / word) for word in ("settings", "handover")}
    events: list[Event] = []
    cluster = ClusterFiles(local(folder, side="cloud", **given), events.append)
    {"settings": cluster._settings, "handover": cluster._handover}[name](text, "")
    return events


def test_new_settings_and_a_handover_are_told(tmp_path: Path) -> None:
    text = "/**: {ros__parameters: {generation: 4, pin: Robot}}"
    assert happened(tmp_path, "settings", text) == [SettingsRead(OFFER)]
    assert happened(tmp_path, "handover", "end\n") == [HandoverAsked("end")]


def test_settings_that_are_none_are_told_with_the_reason(tmp_path: Path) -> None:
    (event,) = happened(tmp_path, "settings", "{")
    assert isinstance(event, SettingsRead)
    assert event.offer is None
    assert "not YAML" in event.problem


def test_a_handover_of_an_earlier_agent_in_the_pod_moves_nobody(tmp_path: Path) -> None:
    assert not happened(tmp_path, "handover", "end", age_s=LEAVING_S + 1.0)
    assert not happened(tmp_path, "handover", "")


def test_the_state_is_written_at_changes_and_again_after_a_while(tmp_path: Path) -> None:
    cluster = ClusterFiles(local(tmp_path, side="cloud", state_file=str(tmp_path / "state.json")), lambda _: None)
    assert cluster.writer is not None
    written: list[Any] = []
    cluster.writer.write = lambda text: written.append(json.loads(text))  # type: ignore[method-assign]
    for site, now_s in (("robot", 0.0), ("robot", RENEW_S / 2), ("cloud", RENEW_S), ("cloud", 3 * RENEW_S)):
        cluster.tell({"site": site}, now_s, lambda: {"figure": len(written)})
    assert [(w["site"], w["figure"]) for w in written] == [("robot", 0), ("cloud", 1), ("cloud", 2)]
    assert written[0]["written"].endswith("Z")
