"""YAML files with the meaning of the YAML 1.2 core schema, read from hostile input without surprises.

``1e6`` is a number, ``on``, ``yes`` and ``2026-01-01`` are text, a key that is written twice is an error, and size,
depth and aliases are bounded before anything is built. ruamel.yaml does the syntax (its event stream); the meaning of
plain scalars is the table in section 10.3.2 of the YAML 1.2.2 specification, written down here, because the readers
for Python add extensions of their own to it (dates, ``1_000``, merge keys).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phys4dgen.errors import FormatError

__all__ = [
    "MAX_BYTES",
    "MAX_DEPTH",
    "MAX_VALUES",
    "YamlDocument",
    "YamlPath",
    "format_yaml",
    "parse_yaml",
    "plain_value",
    "read_yaml",
]

MAX_BYTES = 200_000
"""Longest file that is read; a scene of a thousand parts takes half of it."""
MAX_VALUES = 10_000
"""Most values that a document may hold once its aliases are followed."""
MAX_DEPTH = 32
"""Deepest nesting."""
_LONGEST_KEY = 120
"""Characters; messages quote keys."""

YamlPath = tuple[Any, ...]
"""Keys and list positions from the document's root to a value."""

_INT = re.compile(r"[-+]?[0-9]{1,400}")
_OCTAL = re.compile(r"0o[0-7]{1,400}")
_HEX = re.compile(r"0x[0-9a-fA-F]{1,400}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"([-+])?(\.inf|\.Inf|\.INF)")
_PLAIN_TEXT = re.compile(r"[A-Za-z_/][A-Za-z0-9_/.+-]*")


@dataclass(frozen=True)
class YamlDocument:
    """A document's value, and the line (from 1) on which each of its values starts."""

    value: Any
    lines: Mapping[YamlPath, int]


@dataclass
class _Node:
    """A value while it is read, with what an alias to it needs."""

    value: Any
    lines: dict[YamlPath, int]
    size: int


def read_yaml(path: Path) -> YamlDocument:
    """Read the one YAML document of a file.

    Raises:
        FormatError: the file cannot be read, is too large, is not UTF-8 or is not YAML; names file and line.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise FormatError(f"{path}: cannot read the file: {error.strerror or error}.") from error
    if len(data) > MAX_BYTES:
        raise FormatError(f"{path}: expected at most {MAX_BYTES:,} bytes of YAML, got more; is this the right file?")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(
            f"{path}: expected UTF-8 text, got byte 0x{data[error.start]:02x} at {error.start}."
        ) from error
    return parse_yaml(text, source=str(path))


def parse_yaml(text: str, *, source: str) -> YamlDocument:
    """Read the one YAML document in ``text``; ``source`` is its name in errors.

    Raises:
        FormatError: the text is not YAML, or breaks one of the bounds above; names source and line.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    if re.search(r"^%", text, re.MULTILINE):
        raise FormatError(f"{source}: YAML directives (lines that start with '%') are not used here; remove them.")
    deep = re.search(rf"(?:[\[{{]\s*){{{MAX_DEPTH + 1}}}", text)  # which the scanner would take many seconds over
    if deep is not None:
        line = text.count("\n", 0, deep.end()) + 1
        raise FormatError(f"{source} line {line}: nested deeper than {MAX_DEPTH} levels.")
    try:
        return _Reader(YAML(typ="safe", pure=True).parse(text), source).document()
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f" line {mark.line + 1}" if mark is not None else ""
        problem = error.problem or error.context or "not YAML"
        raise FormatError(f"{source}{place}: expected YAML, but {problem}.") from error
    except YAMLError as error:
        raise FormatError(f"{source}: expected YAML text, but {str(error).splitlines()[0]}.") from error
    except RecursionError as error:
        raise FormatError(f"{source}: nested deeper than {MAX_DEPTH} levels.") from error


class _Reader:
    """Builds values from the parser's events."""

    def __init__(self, events: Any, source: str) -> None:
        self._events = iter(events)
        self._source = source
        self._anchors: dict[str, _Node] = {}
        self._count = 0

    def document(self) -> YamlDocument:
        from ruamel.yaml.events import DocumentEndEvent, DocumentStartEvent, StreamEndEvent, StreamStartEvent

        root: _Node | None = None
        for event in self._events:
            if isinstance(event, (StreamStartEvent, DocumentEndEvent)):
                continue
            if isinstance(event, StreamEndEvent):
                break
            if not isinstance(event, DocumentStartEvent) or root is not None:
                raise self._error(event, "expected one YAML document, got a second one")
            root = self._node(self._next(), depth=0)
        if root is None:
            return YamlDocument(None, {})
        return YamlDocument(root.value, root.lines)

    def _next(self) -> Any:
        return next(self._events)

    def _node(self, event: Any, *, depth: int) -> _Node:
        from ruamel.yaml.events import AliasEvent, MappingStartEvent, ScalarEvent

        if depth > MAX_DEPTH:
            raise self._error(event, f"nested deeper than {MAX_DEPTH} levels")
        if isinstance(event, AliasEvent):
            node = self._anchors.get(event.anchor)
            if node is None:
                raise self._error(event, f"the alias *{event.anchor} names nothing that was read before")
            self._add(event, node.size)
            return node
        self._add(event, 1)
        if event.ctag is not None and str(event.ctag) != "!":
            raise self._error(event, f"tags are not used here, got {event.ctag}")
        if isinstance(event, ScalarEvent):
            value = plain_value(event.value) if event.style is None and event.ctag is None else event.value
            node = _Node(value, {(): event.start_mark.line + 1}, 1)
        elif isinstance(event, MappingStartEvent):
            node = self._mapping(event, depth)
        else:
            node = self._sequence(event, depth)
        if event.anchor is not None:
            self._anchors[event.anchor] = node
        return node

    def _mapping(self, start: Any, depth: int) -> _Node:
        from ruamel.yaml.events import MappingEndEvent

        result = _Node({}, {(): start.start_mark.line + 1}, 1)
        while not isinstance(event := self._next(), MappingEndEvent):
            key = self._node(event, depth=depth + 1).value
            if not isinstance(key, Hashable):
                raise self._error(event, "expected a word or a number as the key, got a list or a mapping")
            if isinstance(key, str) and len(key) > _LONGEST_KEY:
                said = f"expected keys of at most {_LONGEST_KEY} characters, got one of {len(key)}"
                raise self._error(event, f"{said}: '{key[:40]}...'")
            if key in result.value:
                raise self._error(event, f"the key '{key}' is written twice")
            child = self._node(self._next(), depth=depth + 1)
            self._attach(result, key, child)
            result.lines[(key,)] = event.start_mark.line + 1  # the line of the key, not of a value below it
            result.value[key] = child.value
        return result

    def _sequence(self, start: Any, depth: int) -> _Node:
        from ruamel.yaml.events import SequenceEndEvent

        result = _Node([], {(): start.start_mark.line + 1}, 1)
        while not isinstance(event := self._next(), SequenceEndEvent):
            child = self._node(event, depth=depth + 1)
            self._attach(result, len(result.value), child)
            result.value.append(child.value)
        return result

    def _attach(self, parent: _Node, key: Any, child: _Node) -> None:
        parent.size += child.size
        parent.lines.update({(key, *path): line for path, line in child.lines.items()})

    def _add(self, event: Any, count: int) -> None:
        self._count += count
        if self._count > MAX_VALUES:
            raise self._error(event, f"expected at most {MAX_VALUES:,} values once aliases are followed, got more")

    def _error(self, event: Any, problem: str) -> FormatError:
        return FormatError(f"{self._source} line {event.start_mark.line + 1}: {problem}.")


def plain_value(text: str) -> Any:
    """Meaning of an unquoted scalar: YAML 1.2.2, section 10.3.2 (core schema)."""
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in ("true", "True", "TRUE"):
        return True
    if text in ("false", "False", "FALSE"):
        return False
    for pattern, base in ((_INT, 10), (_OCTAL, 8), (_HEX, 16)):
        if pattern.fullmatch(text):
            return int(text[2:] if base != 10 else text, base)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITY.fullmatch(text):
        return -math.inf if text.startswith("-") else math.inf
    if text in (".nan", ".NaN", ".NAN"):
        return math.nan
    return text


def format_yaml(value: Any, *, comments: Mapping[tuple[str, ...], str] | None = None) -> str:
    """Write nested mappings, lists, text, numbers, booleans and None as YAML that ``parse_yaml`` reads back the same.

    Args:
        value: a mapping at the root; tuples are written as lists.
        comments: text for the end of the line of a key, by the keys from the root.
    """
    if not value:
        return "{}\n"
    lines: list[str] = []
    _write_mapping(lines, value, comments or {}, ())
    return "\n".join(lines) + "\n"


def _write_mapping(
    lines: list[str], value: Mapping[Any, Any], comments: Mapping[tuple[str, ...], str], path: tuple[str, ...]
) -> None:
    indent = "  " * len(path)
    for key, child in value.items():
        here = (*path, str(key))
        head = f"{indent}{_inline(key)}:"
        comment = f"  # {comments[here]}" if here in comments else ""
        if isinstance(child, Mapping) and child:
            lines.append(head + comment)
            _write_mapping(lines, child, comments, here)
        elif isinstance(child, (list, tuple)) and any(isinstance(item, Mapping) for item in child):
            lines.append(head + comment)
            lines.extend(f"{indent}  - {_inline(item)}" for item in child)
        else:
            lines.append(f"{head} {_inline(child)}{comment}")


def _inline(value: Any) -> str:
    """One value on one line, in flow style where it is a collection."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if math.isnan(value):
            return ".nan"
        return repr(value) if math.isfinite(value) else (".inf" if value > 0 else "-.inf")
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_inline(key)}: {_inline(child)}" for key, child in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_inline(item) for item in value) + "]"
    return _text(str(value))


def _text(text: str) -> str:
    if _PLAIN_TEXT.fullmatch(text) and isinstance(plain_value(text), str):
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(char if char.isprintable() or ord(char) < 32 else _escaped(char) for char in quoted)


def _escaped(char: str) -> str:
    return f"\\U{ord(char):08x}" if ord(char) > 0xFFFF else f"\\u{ord(char):04x}"
