"""YAML as Kubernetes people write it, read strictly and without surprises: text in, plain values out.

Beyond what a YAML library checks: a key given twice is an error (the first one would be lost silently),
nothing but text, numbers, truth values, lists and mappings comes out (no dates, no tags, no `10:30` as a
number), keys are always text, and a file of nested aliases cannot blow up memory. Lists come out as tuples.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, TypeAlias

import yaml

Value: TypeAlias = "bool | int | float | str | tuple[Value, ...] | dict[str, Value] | None"

MAX_CHARACTERS: Final = 1_000_000
"""About what an API server stores in one object (1.5 MiB); nobody writes more by hand."""
MAX_VALUES: Final = 50_000
"""Values after all aliases are expanded."""

MAX_DEPTH: Final = 50
"""Lists and mappings in each other; a specification needs about ten."""

_TOO_DEEP = f"lists or mappings are nested too deeply; at most {MAX_DEPTH} levels are read"
_TAG = "tag:yaml.org,2002:"
_TRUTH = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
_NULL = re.compile(r"~|null|Null|NULL|")
_BOOL = re.compile(r"yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF")
# At most 18 digits, so that every integer fits the 64 bits of a ROS parameter and of JSON readers.
_INT = re.compile(r"[-+]?(?:0x[0-9a-fA-F]{1,15}|0|[1-9][0-9]{0,17})")
_FLOAT = re.compile(
    r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?[0-9]+[eE][-+]?[0-9]+"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
)


class YamlError(ValueError):
    """The text is not acceptable YAML.

    Attributes:
        position: `line 3, column 5`, or empty when the problem has no place.
        problem: what is wrong, in one line.
    """

    def __init__(self, problem: str, position: str = "") -> None:
        self.position = position
        self.problem = " ".join(problem.split())
        super().__init__(f"{position}: {self.problem}" if position else self.problem)


class _Loader(yaml.reader.Reader, yaml.scanner.Scanner, yaml.parser.Parser, yaml.composer.Composer,
              yaml.resolver.BaseResolver):  # fmt: skip
    """Composes nodes with our own scalar types; `_build` makes values of them."""

    def __init__(self, text: str) -> None:
        yaml.reader.Reader.__init__(self, text)
        yaml.scanner.Scanner.__init__(self)
        yaml.parser.Parser.__init__(self)
        yaml.composer.Composer.__init__(self)
        yaml.resolver.BaseResolver.__init__(self)


def _resolve(name: str, pattern: re.Pattern[str]) -> None:
    _Loader.add_implicit_resolver(f"{_TAG}{name}", re.compile(rf"(?:{pattern.pattern})\Z"), None)


_resolve("null", _NULL)
_resolve("bool", _BOOL)
_resolve("int", _INT)
_resolve("float", _FLOAT)
_resolve("merge", re.compile("<<"))


def parse(text: str) -> Value:
    """Reads one YAML document.

    Raises:
        YamlError: with line and column wherever there is one. Nothing else is raised, whatever the text.
    """
    if len(text) > MAX_CHARACTERS:
        raise YamlError(f"the text has {len(text)} characters, at most {MAX_CHARACTERS} are read")
    try:
        documents = _compose(text)
        if not documents:
            raise YamlError("the file is empty")
        if len(documents) > 1:
            mark = _position(documents[1].start_mark)
            raise YamlError("a second document starts here (after ---); put each object into a file of its own", mark)
        return _Builder().build(documents[0])
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise YamlError(f"the character {error.character:#06x} is not allowed", f"line {line}") from error
    except yaml.MarkedYAMLError as error:
        problem = ", ".join(part for part in (error.context, error.problem) if part)
        raise YamlError(problem or "not YAML", _position(error.problem_mark or error.context_mark)) from error
    except yaml.YAMLError as error:
        raise YamlError(str(error)) from error
    except RecursionError:
        raise YamlError(_TOO_DEEP) from None


def _compose(text: str) -> list[yaml.Node]:
    loader = _Loader(text)
    documents = []
    while loader.check_node():
        node = loader.get_node()
        if node is not None:
            documents.append(node)
    return documents


def _position(mark: yaml.Mark | None) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""


class _Builder:
    """Makes plain values of nodes, counting them so that aliases of aliases stay harmless."""

    def __init__(self) -> None:
        self._values = 0
        self._open: set[int] = set()

    def build(self, node: yaml.Node) -> Value:
        self._values += 1
        if self._values > MAX_VALUES:
            raise YamlError(f"more than {MAX_VALUES} values after its aliases are expanded")
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node)
        if id(node) in self._open:
            raise YamlError("an alias (*name) refers to the value that it stands in", _position(node.start_mark))
        if len(self._open) >= MAX_DEPTH:
            raise YamlError(_TOO_DEEP, _position(node.start_mark))
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.SequenceNode) and node.tag == f"{_TAG}seq":
                return tuple(self.build(child) for child in node.value)
            if isinstance(node, yaml.MappingNode) and node.tag == f"{_TAG}map":
                return self._mapping(node)
        finally:
            self._open.discard(id(node))
        raise _unsupported_tag(node)

    def _mapping(self, node: yaml.MappingNode) -> dict[str, Value]:
        values: dict[str, Value] = {}
        for key, child in node.value:
            where = _position(key.start_mark)
            if not isinstance(key, yaml.ScalarNode):
                raise YamlError("a key must be text, not a list or a mapping", where)
            if key.tag == f"{_TAG}merge":
                raise YamlError("merge keys (<<) are not read; write the fields out", where)
            if key.value in values:
                raise YamlError(f"the key {key.value!r} is given twice; remove one", where)
            values[key.value] = self.build(child)
        return values


def _scalar(node: yaml.ScalarNode) -> Value:
    """The value of a scalar; a tag written by hand must fit its text."""
    text = str(node.value)
    kind = node.tag.removeprefix(_TAG)
    if kind in {"str", "merge"}:
        return text
    if kind == "null" and _NULL.fullmatch(text):
        return None
    if kind == "bool" and _BOOL.fullmatch(text):
        return _TRUTH[text.lower()]
    if kind == "int" and _INT.fullmatch(text):
        return int(text, 0)
    if kind == "float" and (_FLOAT.fullmatch(text) or _INT.fullmatch(text)):
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    raise _unsupported_tag(node)


def _unsupported_tag(node: yaml.Node) -> YamlError:
    return YamlError(f"the tag {node.tag!r} does not fit here; remove it", _position(node.start_mark))


def thaw(value: object) -> object:
    """`value` with tuples as lists, the form that JSON and YAML writers take."""
    if isinstance(value, Mapping):
        return {key: thaw(child) for key, child in value.items()}
    if isinstance(value, tuple | list):
        return [thaw(child) for child in value]
    return value


def freeze(value: object) -> object:
    """`value` with lists as tuples, the form that `parse` gives."""
    if isinstance(value, Mapping):
        return {key: freeze(child) for key, child in value.items()}
    if isinstance(value, tuple | list):
        return tuple(freeze(child) for child in value)
    return value
