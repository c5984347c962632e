"""Whose keys a RobotOffload goes on with, and how long keys outlive theirs."""

from __future__ import annotations

import datetime
from typing import Any

from robot_offload.decide.authorities import IDENTITY, KEPT_MOST, ORPHANED, SERVES, expired, heritage
from robot_offload.decide.certificates import issue
from robot_offload.objects.parent import Parent
from tests.unit.operator.decide.worlds import FACTS, NOW, offload

PARENT = Parent(offload(), FACTS)
MONTH = datetime.timedelta(days=30)


def pair(
    uid: str, serves: str = "fleet/walker", made: str = "2026-01-01T00:00:00Z", **more: str
) -> list[dict[str, Any]]:
    annotations = {SERVES: serves, **more}
    return [
        {
            "metadata": {
                "name": f"{role}-{uid}",
                "annotations": annotations,
                "creationTimestamp": made,
                "uid": role + uid,
            }
        }
        for role in ("server-ca", "client-ca")
    ]


def orphans(uid: str, days: float, serves: str = "fleet/walker") -> list[dict[str, Any]]:
    return pair(uid, serves, **{ORPHANED: (NOW - datetime.timedelta(days=days)).isoformat()})


def test_it_goes_on_with_the_youngest_of_its_namespace_and_name() -> None:
    secrets = [*pair("u-8"), *pair("u-9", made="2026-02-01T00:00:00Z"), *pair("u-7", "other/walker"), *pair("u-1")]
    assert heritage(secrets, PARENT) == "u-9"
    assert heritage([*pair("u-7", "other/walker"), *pair("u-6", "fleet/runner"), *pair("u-1")], PARENT) == ""


def test_half_a_heritage_is_none() -> None:
    assert heritage(pair("u-9")[:1], PARENT) == ""


def test_keys_go_when_their_time_is_over() -> None:
    assert expired(orphans("u-9", 29), MONTH, NOW) == []
    assert len(expired(orphans("u-9", 30), MONTH, NOW)) == 2
    assert len(expired(orphans("u-9", 0), datetime.timedelta(), NOW)) == 2


def test_a_mark_that_nobody_can_read_keeps_nothing_for_ever() -> None:
    assert len(expired(pair("u-9", **{ORPHANED: "soon"}), MONTH, NOW)) == 2


def test_one_namespace_cannot_fill_the_operators_own() -> None:
    many = [one for number in range(KEPT_MOST + 3) for one in orphans(f"u-{number}", number / 1000, f"fleet/r{number}")]
    others = orphans("v-1", 20, "other/walker")
    gone = {one["metadata"]["name"] for one in expired([*many, *others], MONTH, NOW)}
    assert gone == {f"{role}-u-{KEPT_MOST + late}" for role in ("server-ca", "client-ca") for late in range(3)}


def test_the_identity_of_the_robot_outlives_every_pass() -> None:
    first = issue(PARENT, {}, "", NOW)
    live: dict[Any, Any] = dict(zip(("server-ca", "client-ca"), first.authorities, strict=True))
    live["server-ca"]["metadata"]["annotations"][IDENTITY] = "u-0"
    again = issue(PARENT, live, "", NOW)
    assert again.authorities[0]["metadata"]["annotations"][IDENTITY] == "u-0"
    assert again.leaves[1]["metadata"]["annotations"][IDENTITY] == "u-0"
    assert again.authorities[0]["data"] == first.authorities[0]["data"]
    assert "stays good" in again.verdict.message
