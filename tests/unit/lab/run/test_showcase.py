"""What an example says of itself beside its RobotOffload."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.run.showcase import showcase

ROOT = Path(__file__).parents[4]


def test_the_wheelchair_names_the_topics_of_its_accounts() -> None:
    said = showcase(ROOT / "examples/wheelchair/robotoffload.yaml")
    assert (said.state, said.account, said.restored) == (
        "/wheelchair/state",
        "/passenger/account",
        "/localiser/account",
    )


def test_an_example_that_says_nothing_has_no_account() -> None:
    assert showcase(ROOT / "examples/talker/robotoffload.yaml").state == ""


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("state: 3", "state: Input should be a valid string"),
        ("topic: /a", "topic: Extra inputs"),
        ("a: [", "demo.yaml: "),
    ],
)
def test_what_cannot_be_understood_is_named_with_its_file(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "demo.yaml").write_text(text)
    with pytest.raises(InputError, match=r"demo\.yaml") as caught:
        showcase(tmp_path / "robotoffload.yaml")
    assert problem in str(caught.value)


def test_the_lab_knows_no_example_by_its_topics() -> None:
    assert not [path for path in (ROOT / "lab").rglob("*.py") if '"/wheelchair' in path.read_text()]
