"""Rows of the table of links: from what was observed, to the file, to the page."""

import csv
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.bench import link_table
from robot_offload_lab.bench.analysis import links
from robot_offload_lab.bench.analysis.links import ALL, LOADS, SOME, Cell, wide_enough
from robot_offload_lab.bench.resource import offload
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import Arrival, PlacementChange

CELL = Cell(20, 40, 0.1)
FOUND = ("2026-11-22", "a machine", 1.5)
CAMERA = LOADS[1]


def arrival(sent_s, age_s):
    return Arrival("/bench/load", sent_s + age_s, "load", 1, sent_s, "robot")


def placed(t_s, site, reason="LinkGood"):
    return PlacementChange(t_s, site, 1, reason)


IN_CLOUD = (placed(0.0, "cloud"),)


def row(arrivals=(), robot=IN_CLOUD, load=CAMERA, cell=CELL):
    return links.row(load, cell, Interval(10.0, 20.0), arrivals, robot, FOUND)


def test_shares_and_ages_are_of_the_window_alone():
    found = row([arrival(5.0, 9.0), *(arrival(10.0 + n / 10, 0.05) for n in range(50)), arrival(19.99, 0.2)])
    assert found.delivered == 0.51
    assert found.p50_ms == pytest.approx(50.0)
    assert (found.cloud, found.takeovers, found.alarms) == (1.0, 0, 0)


def test_takeovers_are_counted_and_those_by_the_beats_apart():
    told = (
        placed(0.0, "cloud"), placed(12.0, "robot", "InputStale"), placed(13.0, "cloud"),
        placed(14.0, "robot", "HeartbeatLost"), placed(15.0, "cloud"), placed(25.0, "robot", "HeartbeatLost"),
    )  # fmt: skip
    found = row(robot=told)
    assert (found.takeovers, found.alarms, found.reasons) == (2, 1, ("InputStale", "HeartbeatLost"))
    assert found.cloud == pytest.approx(0.8)


def test_nothing_that_arrives_is_said_to_be_nothing():
    found = row()
    assert (found.delivered, found.p50_ms) == (0.0, None)
    assert "compressed,20,40,0.1,0,,,100,0,,0," in links.table([found])


def test_rows_are_read_back_and_a_newer_one_takes_the_place_of_the_older(tmp_path):
    link_table.keep(tmp_path, [row(), row(cell=Cell(5, 10, 0.0))])
    newer = row([arrival(11.0, 0.1)])
    assert link_table.keep(tmp_path, [newer]) == [row(cell=Cell(5, 10, 0.0)), newer]
    assert link_table.read(tmp_path) == [row(cell=Cell(5, 10, 0.0)), newer]
    (tmp_path / link_table.FILE).write_text("[]")
    with pytest.raises(InputError, match="remove it to begin anew"):
        link_table.read(tmp_path)


def test_the_file_beside_the_page_has_a_row_for_each_load_and_link(tmp_path):
    (tmp_path / link_table.TABLE.parent).mkdir(parents=True)
    path = link_table.write_table(tmp_path, [row([arrival(11.0, 0.1)])])
    head, *rows = csv.reader(path.read_text().splitlines())
    assert tuple(head) == links.COLUMNS
    assert rows == [["compressed", "20", "40", "0.1", "1", "100", "100", "100", "0", "", "0", *map(str, FOUND)]]


def test_what_does_not_fit_is_reckoned_where_it_was_not_measured():
    raw = links.table([row([arrival(11.0, 0.1)], load=LOADS[0], cell=CELL)])
    assert "raw,5,,,7,,,,,reckoned: at most,,,,\n" in raw
    assert "raw,20,,," not in raw
    assert "raw,100,,," not in raw


def test_the_published_file_has_the_columns_and_known_loads():
    published = Path(__file__).parents[4] / "docs" / link_table.TABLE
    head, *rows = csv.reader(published.read_text().splitlines())
    assert tuple(head) == links.COLUMNS
    assert {cells[0] for cells in rows} == {load.name for load in LOADS}


def test_only_links_whose_rate_carries_a_load_are_measured_in_full():
    counts = {load.name: len(wide_enough(load.name)) for load in LOADS}
    assert counts == {"raw": 12, "compressed": 36, "cloud": 12, "compressed-cloud": 24}


def test_the_whole_table_has_36_links_and_every_load_can_be_rendered():
    assert len(ALL) == len(set(ALL)) == 36
    for load in LOADS:
        assert set(SOME[load.name]) <= set(ALL)
    for load in LOADS:
        (topic,) = offload(link_table.case(load)).spec.topics.to_cloud
        assert (topic.min_rate_hz, topic.latest) == (3, True)
    with pytest.raises(InputError, match="there is no 'lidar'"):
        link_table.chosen(LOADS, ["lidar"])
