"""The strict YAML reader: plain values or an error with a place, whatever the text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.strict_yaml import YamlError, freeze, parse, thaw


def test_scalars_become_what_kubernetes_tools_make_of_them() -> None:
    text = "{a: 1, b: 1.5, c: True, d: ~, e: text, f: 0x10, g: 1e-3, h: '7', j: 2024-01-01, k: 10:30, l: '007', m: -0}"
    assert parse(text) == {
        "a": 1,
        "b": 1.5,
        "c": True,
        "d": None,
        "e": "text",
        "f": 16,
        "g": 0.001,
        "h": "7",
        "j": "2024-01-01",
        "k": "10:30",
        "l": "007",
        "m": 0,
    }


@pytest.mark.parametrize(
    ("text", "column", "advice"),
    [
        ("{x: 1.5, y: 2.5}", 10, "write 'y' in quotes: kubectl reads this key as true"),
        ("{On: 1}", 2, "write 'On' in quotes: kubectl reads this key as true"),
        ("{0x10: 1}", 2, "write '0x10' in quotes: kubectl reads this key as 16"),
        ("{~: 1}", 2, "write '~' in quotes: kubectl reads this key as null"),
        ("{a: n}", 5, "write 'n' in quotes, or false: kubectl reads n as false"),
        ("{a: yes}", 5, "write 'yes' in quotes, or true: kubectl reads yes as true"),
        ("[0777]", 2, "write '0777' in quotes, or the number as 511: kubectl reads 0777 as 511"),
        ("[-0b11]", 2, "write '-0b11' in quotes, or the number as -3: kubectl reads -0b11 as -3"),
        ("[1_000]", 2, "or the number as 1000"),
        ("[1_000.5]", 2, "or the number as 1000.5"),
        ("[08]", 2, "or the number as 8"),
        ("[9223372036854775808]", 2, "does not fit into 64 bits"),
        (f"[{'9' * 6000}]", 2, "does not fit into 64 bits"),
        (f"{{{'9' * 600}: 1}}", 2, "write this key in quotes"),
        ("[.inf]", 2, "JSON has finite numbers only"),
        ("[-.Inf]", 2, "JSON has finite numbers only"),
        ("[1e400]", 2, "kubectl reads 1e400 as text"),
    ],
)
def test_what_kubectl_reads_as_something_else_is_refused_with_the_text_to_write(
    text: str, column: int, advice: str
) -> None:
    with pytest.raises(YamlError) as caught:
        parse(text)
    assert (caught.value.position, caught.value.problem[-200:]) == (f"line 1, column {column}", caught.value.problem)
    assert advice in caught.value.problem


def test_keys_are_always_text() -> None:
    assert parse("{1: a, 'on': b, '~': c, true: d}") == {"1": "a", "on": "b", "~": "c", "true": "d"}


def test_a_tag_by_hand_must_fit_its_text() -> None:
    assert parse("{a: !!str 1, b: !!float 1, c: !!int '2', d: !!bool true}") == {"a": "1", "b": 1.0, "c": 2, "d": True}


def test_an_alias_stands_for_its_value() -> None:
    assert parse("a: &x [1, 2]\nb: *x") == {"a": (1, 2), "b": (1, 2)}


@pytest.mark.parametrize(
    ("text", "position", "problem"),
    [
        ("a: 1\na: 2", "line 2, column 1", "'a' is given twice"),
        ("a:\n\t- b", "line 2, column 1", "cannot start any token"),
        ("a: [1", "line 1, column 6", "expected ',' or ']'"),
        ("a: 1\n---\nb: 2", "line 3, column 1", "a second document"),
        ("a: &x [*x]", "line 1, column 4", "refers to the value that it stands in"),
        ("a: !!python/name:os.system x", "line 1, column 4", "the tag"),
        ("a: !!int x", "line 1, column 4", "the tag"),
        ("? [a]\n: b", "line 1, column 3", "a key must be text"),
        ("a: 1\n<<: {b: 2}", "line 2, column 1", "merge keys"),
        ("a: 1\nb: \x07", "line 2", "the character 0x0007 is not allowed"),
        ("", "", "the file is empty"),
        ("# only a comment\n", "", "the file is empty"),
        ("[" * 5000, "line 1, column 51", "nested too deeply"),
        ("[" * 60 + "]" * 60, "line 1, column 51", "nested too deeply"),
    ],
)
def test_bad_yaml_is_refused_with_its_place(text: str, position: str, problem: str) -> None:
    with pytest.raises(YamlError) as caught:
        parse(text)
    assert caught.value.position == position
    assert problem in caught.value.problem


@pytest.mark.parametrize("text", ["a: 1\n---\n", "---\na: 1\n---\n", "---\n---\na: 1\n", "a: 1\n---\n# nothing\n---\n"])
def test_a_document_with_nothing_in_it_is_none(text: str) -> None:
    assert parse(text) == {"a": 1}


@pytest.mark.parametrize("text", ["a: 1\n---\n''", "a: 1\n---\n~", "a: 1\n---\n{}"])
def test_a_document_with_a_value_is_one_more(text: str) -> None:
    with pytest.raises(YamlError, match="a second document"):
        parse(text)


def test_aliases_of_aliases_cannot_blow_up_memory() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    with pytest.raises(YamlError, match="after its aliases are expanded"):
        parse("\n".join(lines))


def test_a_huge_text_is_not_even_tried() -> None:
    with pytest.raises(YamlError, match="at most"):
        parse("a: " + "x" * 1_000_001)


@given(st.text(alphabet=st.sampled_from(list("ab:{}[],&*!|>-?#'\"\n\t %@~0.1e<=\\")), max_size=60))
def test_no_text_raises_anything_but_a_yaml_error(text: str) -> None:
    message = ""
    try:
        parse(text)
    except YamlError as error:
        message = str(error)
    assert "\n" not in message


@given(
    st.recursive(
        st.none() | st.integers() | st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)
    )
)
def test_freezing_and_thawing_lose_nothing(value: object) -> None:
    assert thaw(freeze(value)) == value
