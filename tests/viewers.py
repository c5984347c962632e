"""What the layouts in docs/viewers show: topics, each with the field that is drawn ("" for the whole message)."""

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

VIEWERS = Path(__file__).parents[1] / "docs" / "viewers"


def foxglove() -> dict[str, Any]:
    """The layout for Foxglove and Lichtblick."""
    layout: dict[str, Any] = json.loads((VIEWERS / "foxglove-layout.json").read_text())
    return layout


def shown() -> set[tuple[str, str]]:
    """(topic, field) of every panel, curve and list."""
    found = set()
    for panel in foxglove()["configById"].values():
        found |= {tuple(path["value"].split(".", 1)) for path in panel.get("paths", ())}
        found |= {(panel[key], "") for key in ("topicToRender", "topicPath") if key in panel}
    tree = ElementTree.parse(VIEWERS / "plotjuggler-layout.xml")
    found |= {tuple(curve.attrib["name"].rsplit("/", 1)) for curve in tree.iter("curve")}
    return found


def groups() -> list[str]:
    """The beginnings of names that rqt_robot_monitor groups."""
    parameters = yaml.safe_load((VIEWERS / "robot-monitor.yaml").read_text())["analyzers"]["ros__parameters"]
    return [name for group in parameters.values() if isinstance(group, dict) for name in group["startswith"]]
