"""What the layout in docs/viewers shows: topics, each with the field that is drawn ("" for the whole message)."""

import json
from pathlib import Path
from typing import Any

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
    return found
