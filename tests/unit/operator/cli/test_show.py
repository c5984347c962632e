"""What `status` shows."""

from __future__ import annotations

import dataclasses
import json

from rich.console import Console, RenderableType

from robot_offload.api.agent_state import parse_state
from robot_offload.cli.cluster import Live
from robot_offload.cli.status import show
from robot_offload.insight.observed import Observed, observe
from tests.unit.operator.cli.resources import NOW, manifest, observed
from tests.unit.operator.reporter.states import REPORT, text

LIVE = Live(parse_state(text()))
SILENT = Live(problem="there is no cloud agent")


def printed(shown: RenderableType) -> list[list[str]]:
    """The words of each line; two blanks and more divide them."""
    console = Console(width=200, color_system=None)
    with console.capture() as captured:
        console.print(shown)
    lines = [line for line in captured.get().splitlines() if line.strip()]
    return [[word for word in line.split("  ") if word] for line in lines]


def words(shown: RenderableType) -> dict[str, str]:
    """The first columns of the details: name and value."""
    return {line[0].strip(): line[1].strip() for line in printed(shown) if len(line) > 1}


def test_the_table_says_where_why_and_how_good_the_link_is() -> None:
    heading, line = printed(show.table([observed()], [LIVE], NOW))
    assert [word.strip() for word in heading] == [
        "NAME", "PLACEMENT", "REASON", "ROBOT", "LATENCY", "NODES", "READY", "AGE",
    ]  # fmt: skip
    assert [word.strip() for word in line] == [
        "wheelchair-7", "Cloud", "LinkGood", "connected 10m", "12 ms (p99 19 ms)", "2/2", "yes", "2h",
    ]  # fmt: skip


def test_the_agents_own_word_is_newer_than_the_status() -> None:
    live = Live(parse_state(text(site="robot", reason="LinkLost", connected=False)))
    _, line = printed(show.table([observed()], [live], NOW))
    assert [word.strip() for word in line][1:5] == ["Robot", "LinkLost", "gone 10m", "-"]


def test_without_the_agent_the_status_is_shown() -> None:
    _, line = printed(show.table([observed()], [SILENT], NOW))
    assert [word.strip() for word in line][1:5] == ["Cloud", "LinkGood", "connected 10m", "-"]


def test_what_is_not_ready_shows_its_reason() -> None:
    broken = observed(Ready=("False", "ImagePullFailing", "no image"))
    waiting = dataclasses.replace(observed(), generation=4)
    young = observe({"metadata": {"name": "young", "namespace": "ward", "generation": 1}, "spec": {}})
    lines = printed(show.table([broken, waiting, young], [LIVE, LIVE, SILENT], NOW, namespaces=True))
    assert [line[-2].strip() for line in lines[1:]] == ["ImagePullFailing", "in progress", "no status"]
    assert {line[0].strip() for line in lines[1:]} == {"ward"}


def test_the_details_say_everything_once() -> None:
    lines = words(show.details(observed(), LIVE, NOW))
    assert lines["Placement"] == "Cloud, LinkGood: the link sustains the cloud"
    assert lines["Round trip"] == "12 ms (p99 19 ms)"
    assert lines["Settings"] == "generation 3, current on the robot"
    assert lines["pulse"] == "UDP"
    assert lines["WorkloadsAvailable"] == "True"
    assert "Held by" not in lines
    assert "Live numbers" not in lines


def test_whatever_holds_the_application_is_named() -> None:
    values = manifest()
    values["spec"]["switching"] |= {"pin": "Robot", "mode": "Observe"}
    values["spec"]["replicas"] = 0
    held = words(show.details(observe(values), SILENT, NOW))["Held by"]
    assert [part.split(" ")[0:2] for part in held.split("; ")] == [
        ["pin", "Robot"],
        ["mode", "Observe:"],
        ["replicas", "0:"],
    ]


def test_the_end_of_a_pin_is_there_for_programs() -> None:
    assert show.plain(observed(), SILENT)["pinnedUntil"] is None
    pinned = dataclasses.replace(observed(), pin="Robot", pinned_until="2026-11-23T12:00:00+00:00")
    assert show.plain(pinned, SILENT)["pinnedUntil"] == "2026-11-23T12:00:00+00:00"


def test_settings_that_the_robot_refused_are_explained() -> None:
    refused = {"robot_generation": 2, "accepted": False, "reason": "NeedsBundle", "message": "outputs have changed"}
    state = parse_state(text(settings=refused))
    assert show.settings(observed(), state) == "the robot runs generation 2 of 3: NeedsBundle, outputs have changed"


def test_a_name_that_looks_like_markup_is_shown_as_it_is() -> None:
    values = manifest(Ready=("False", "Odd", "[red]not red[/red] [/]"))
    assert any("[red]not red[/red] [/]" in " ".join(line) for line in printed(show.details(observe(values), LIVE, NOW)))


def serving() -> Observed:
    values = manifest()
    values["spec"]["nodes"][0] |= {"actions": [{"name": "/go"}], "services": [{"name": "/plan"}]}
    return observe(values)


def test_goals_and_calls_in_flight_restarts_and_the_age_of_state_are_shown() -> None:
    lines = words(show.details(serving(), Live(parse_state(text(robot=REPORT))), NOW))
    assert lines["Goals"] == "/go 1 executing, 2 waiting, 4 restarts; 1 at servers outside"
    assert lines["Calls"] == "/plan 3 open"
    assert lines["State"] == "controller_1 85 ms in the cloud, amcl 80 ms on the robot"
    quiet = REPORT | {"actions": {"/go": [0, 0, 1]}, "services": {"/plan": 0}, "used": [0, 0]}
    lines = words(show.details(serving(), Live(parse_state(text(robot=quiet))), NOW))
    assert (lines["Goals"], lines["Calls"]) == ("/go none in flight, 1 restart", "/plan none open")


def test_goals_of_a_robot_that_says_nothing_are_not_known_and_who_declares_none_sees_none() -> None:
    assert words(show.details(serving(), LIVE, NOW))["Goals"].startswith("not known")
    assert "Goals" not in words(show.details(serving(), SILENT, NOW))
    assert "Goals" not in words(show.details(observed(), LIVE, NOW))


def test_programs_get_what_is_in_flight() -> None:
    plain = json.loads(json.dumps(show.plain(serving(), Live(parse_state(text(robot=REPORT))))))
    assert plain["goals"] == [{"action": "/go", "executing": 1, "waiting": 2, "restarts": 4}]
    assert plain["calls"] == [{"service": "/plan", "open": 3}]
    assert plain["used"] == {"goals": 1, "calls": 0}
    assert plain["stateAgesMs"] == {"cloud": {"controller_1": 85}, "robot": {"amcl": 80}}
    unknown = show.plain(serving(), LIVE)
    assert [unknown[name] for name in ("goals", "calls", "used")] == [None] * 3
    assert show.plain(serving(), SILENT)["stateAgesMs"] is None


def test_programs_get_the_same() -> None:
    plain = json.loads(json.dumps(show.plain(observed(), LIVE)))
    assert (plain["placement"], plain["ready"], plain["live"]) == ("Cloud", True, True)
    assert plain["roundTripMs"] == {"p50": 11.5, "p99": 19.0}
    assert show.plain(observed(), SILENT)["roundTripMs"] is None
