"""YAML as Kubernetes people write it, read strictly and without surprises: text in, plain values out.

PyYAML scans, parses and composes; this is what it leaves open. A key given twice is an error (the first one would be
lost silently), nothing but text, numbers, truth values, lists and mappings comes out, keys are always text, a file of
nested aliases cannot blow up memory, and scalars are what kubectl makes of them (`scalars`). Lists come out as tuples.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias, TypeVar

import yaml

from robot_offload.api import scalars

Value: TypeAlias = "bool | int | float | str | tuple[Value, ...] | dict[str, Value] | None"

MAX_CHARACTERS: Final = 1_000_000
"""About what an API server stores in one object (1.5 MiB); nobody writes more by hand."""
MAX_VALUES: Final = 50_000
"""Values after all aliases are expanded."""

MAX_DEPTH: Final = 50
"""Lists and mappings in each other; a specification needs about ten."""

_TOO_DEEP = f"lists or mappings are nested too deeply; at most {MAX_DEPTH} levels are read"
_TAG = "tag:yaml.org,2002:"
_KINDS: Final[Mapping[type, str]] = {type(None): "null", bool: "bool", int: "int", float: "float"}
_Read = TypeVar("_Read")
_PLAIN = f"{_TAG}plain"
"""The tag of what has neither quotes nor a tag of its own."""


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
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose one node; refuse to go deeper than anybody writes."""
        if self._depth >= MAX_DEPTH and self.check_event(yaml.SequenceStartEvent, yaml.MappingStartEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise YamlError(_TOO_DEEP, _position(event.start_mark))
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


_Loader.add_implicit_resolver(_PLAIN, re.compile(""), None)


def parse(text: str) -> Value:
    """Read one YAML document.

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
        if node is not None and not _empty(node):
            documents.append(node)
    return documents


def _empty(node: yaml.Node) -> bool:
    """Return whether a document has nothing in it: what ends with `---` has one more."""
    return isinstance(node, yaml.ScalarNode) and not node.value and node.tag == _PLAIN and not node.style


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
            if key.tag == f"{_TAG}merge" or (key.tag == _PLAIN and key.value == "<<"):
                raise YamlError("merge keys (<<) are not read; write the fields out", where)
            name = _key(key)
            if name in values:
                raise YamlError(f"the key {name!r} is given twice; remove one", where)
            values[name] = self.build(child)
        return values


def _scalar(node: yaml.ScalarNode) -> Value:
    """Return the value of a scalar; a tag written by hand must fit its text."""
    text, kind = str(node.value), node.tag.removeprefix(_TAG)
    if kind == "str":
        return text
    value = _checked(scalars.read, node)
    if node.tag == _PLAIN or kind == _KINDS.get(type(value)):
        return value
    if kind == "float" and type(value) is int:
        return float(value)
    raise _unsupported_tag(node)


def _key(node: yaml.ScalarNode) -> str:
    """Return the text of a key, the same for kubectl."""
    return _checked(scalars.read_key, node) if node.tag == _PLAIN else str(node.value)


def _checked(read: Callable[[str], _Read], node: yaml.ScalarNode) -> _Read:
    try:
        return read(str(node.value))
    except scalars.ScalarError as error:
        raise YamlError(str(error), _position(node.start_mark)) from error


def _unsupported_tag(node: yaml.Node) -> YamlError:
    return YamlError(f"the tag {node.tag!r} does not fit here; remove it", _position(node.start_mark))


def thaw(value: object) -> object:
    """Return `value` with tuples as lists, the form that JSON and YAML writers take."""
    if isinstance(value, Mapping):
        return {key: thaw(child) for key, child in value.items()}
    if isinstance(value, tuple | list):
        return [thaw(child) for child in value]
    return value


def freeze(value: object) -> object:
    """Return `value` with lists as tuples, the form that `parse` gives."""
    if isinstance(value, Mapping):
        return {key: freeze(child) for key, child in value.items()}
    if isinstance(value, tuple | list):
        return tuple(freeze(child) for child in value)
    return value
