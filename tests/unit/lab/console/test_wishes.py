"""What a person does to a running demo: settings of a new generation for the cloud's agent, and when that is over."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload.console.actions import Action, Want
from robot_offload.errors import InputError
from robot_offload_lab.console.wishes import ONE_SIDE, OVER, Wishes

MANIFEST: Mapping[str, Any] = {"metadata": {"name": "talker"}, "spec": {"switching": {"lossTimeout": "80ms"}}}


def offered(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]
    return found


def test_each_wish_is_an_offer_of_a_newer_generation_and_a_change_of_what_pages_show(tmp_path: Path) -> None:
    seen: list[Mapping[str, Any]] = []
    wishes = Wishes(MANIFEST, str(tmp_path / "settings.yaml"), seen.append)
    assert offered(tmp_path / "settings.yaml") == {"generation": 1}
    said = wishes.act(Action(Want.PIN_ROBOT), connected=True)
    assert said == "talker: held on the robot until it is taken back; generation 2"
    assert offered(tmp_path / "settings.yaml") == {"generation": 2, "pin": "Robot"}
    assert seen[-1]["spec"]["switching"] == {"lossTimeout": "80ms", "pin": "Robot"}
    assert seen[-1]["metadata"]["generation"] == 2
    assert "never switches" in wishes.act(Action(Want.OBSERVE), connected=True)
    assert offered(tmp_path / "settings.yaml") == {"generation": 3, "mode": "Observe", "pin": "Robot"}
    assert "not connected" in wishes.act(Action(Want.PIN_CLOUD), connected=False)


def test_a_pin_for_some_time_ends_by_itself(tmp_path: Path) -> None:
    seen: list[Mapping[str, Any]] = []

    async def run() -> None:
        wishes = Wishes(MANIFEST, str(tmp_path / "settings.yaml"), seen.append)
        wishes.act(Action(Want.PIN_CLOUD, 0.2), connected=True)
        assert offered(tmp_path / "settings.yaml")["pin"] == "Cloud"
        async with asyncio.timeout(60):
            while offered(tmp_path / "settings.yaml")["pin"] != "Auto":
                await asyncio.sleep(0.02)

    asyncio.run(run())
    assert [each["spec"]["switching"]["pin"] for each in seen] == ["Cloud", "Auto"]
    assert seen[-1]["metadata"]["annotations"] == {}


def test_nobody_hears_a_wish_after_the_run_or_where_one_side_runs(tmp_path: Path) -> None:
    wishes = Wishes(MANIFEST, str(tmp_path / "settings.yaml"), lambda _: None)
    assert wishes.may().allowed
    wishes.over()
    assert (wishes.may().allowed, wishes.may().reason) == (False, OVER)
    with pytest.raises(InputError, match=OVER):
        wishes.act(Action(Want.PIN_ROBOT), connected=True)
    alone = Wishes(MANIFEST, "", lambda _: None)
    alone.over()
    assert alone.may().reason == ONE_SIDE
