"""What all pictures share: colours, style, and how a figure becomes a file. Without any global state of matplotlib.

Two colours stand for the two sides everywhere: orange for the robot, blue for the cloud (Okabe and Ito's palette, which
is distinct with every kind of colour vision and in grey). Where it matters a shape or a word repeats the information.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Final

import matplotlib as mpl
from matplotlib.figure import Figure

from robot_offload_lab.judge.recording import Site

ORANGE: Final = "#E69F00"
BLUE: Final = "#0072B2"
VERMILION: Final = "#D55E00"
GREEN: Final = "#009E73"
INK: Final = "#333333"
GREY: Final = "#999999"
SILVER: Final = "#BBBBBB"
PALE: Final = "#DDDDDD"
SITE_COLOURS: Final[Mapping[Site, str]] = {"robot": ORANGE, "cloud": BLUE}
_DPI: Final = 120


def style() -> AbstractContextManager[None]:
    """Return our settings for the time of one drawing or saving; matplotlib's own stay as they were."""
    return mpl.rc_context(
        {
            "font.size": 10,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.edgecolor": INK,
            "legend.frameon": False,
            "svg.fonttype": "path",
            "svg.hashsalt": "robot-offload",
        }
    )


def svg(figure: Figure) -> str:
    """Return a figure as an `<svg>` element that scales to the page; the same input gives the same text."""
    text = io.StringIO()
    with style():
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG file."""
    data = io.BytesIO()
    with style():
        figure.savefig(data, format="png", dpi=_DPI, metadata={"Software": None})
    return data.getvalue()
