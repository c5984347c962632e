"""Every word that agents and core give as a reason is explained in the reference page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robot_offload_agent.link.port import LinkCause
from robot_offload_agent.settings.offer import Answer
from robot_offload_core.control.cloud.lease import Stand
from robot_offload_core.control.nodes.managed_nodes import NodeEvent
from robot_offload_core.words.gates import Ruling
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.reasons import Explained, Reason

REPOSITORY = Path(__file__).parents[3]
SOURCES = sorted(
    path
    for room in ("agent/robot_offload_agent", "core/robot_offload_core")
    for path in (REPOSITORY / room).rglob("*.py")
)
WORDS: tuple[type[Explained], ...] = (Reason, Problem, Answer, NodeEvent, Stand, Ruling, LinkCause)
KNOWN = {word.value for words in WORDS for word in words}
GIVEN = re.compile(r"""(?:\(|return |reason, message = )"([A-Z][a-z]+(?:[A-Z][a-z]+)+)", """)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_a_reason_that_is_given_as_text_is_one_that_is_explained(path: Path) -> None:
    assert set(GIVEN.findall(path.read_text())) <= KNOWN, "add the word to problems.py, then make generate"


@pytest.mark.parametrize("words", WORDS)
def test_causes_and_next_steps_are_parts_of_sentences_in_one_line(words: type[Explained]) -> None:
    for word in words:
        for text in (word.cause, word.advice):
            assert "\n" not in text
            assert "|" not in text
            assert not text.endswith(".")


def test_the_page_has_every_word_with_its_next_step() -> None:
    page = (REPOSITORY / "docs/reference/reasons.md").read_text()
    for words in WORDS:
        for word in filter(None, words):
            assert re.search(rf"^\| `{word}` \|.*\| {re.escape(word.advice or '-')} \|$", page, re.M), word
