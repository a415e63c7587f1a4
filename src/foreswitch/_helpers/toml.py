"""TOML: tables as the text of a file, and a file's text with other values, in which its author's comments stay."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import tomlkit
from tomlkit.items import AoT, Array, Item, Table, Trivia, Whitespace

__all__ = ["toml_edited", "toml_text"]

#: Column of the comments behind values, and the length of a line beyond which one would not be seen.
COLUMN, MARGIN = 40, 60


def toml_text(
    tables: Mapping[str, Any],
    *,
    heading: Sequence[str] = (),
    meaning: Callable[[str, str], str | None] = lambda table, key: None,
) -> str:
    """Tables, or lists of them, by name: comments above, and behind each key of a table what it means.

    Keys without a value are left out. Within a table its own keys come first, then the tables in it.
    """
    document = tomlkit.document()
    for line in heading:
        document.add(tomlkit.comment(line))
    for name, content in tables.items():
        document.add(name, _tables(name, content, meaning))
    return document.as_string()


def toml_edited(text: str, tables: Mapping[str, Any]) -> str:
    """The text of a file with these tables in it; what stays keeps its place, its spelling and its comments.

    Raises
    ------
    ValueError
        If the text is not TOML.
    """
    document = tomlkit.parse(text)
    _edit(document, tables)
    return document.as_string()


def _edit(node: Any, wanted: Mapping[str, Any]) -> None:
    given = {key: value for key, value in wanted.items() if value is not None}
    for key in [key for key in node if key not in given]:
        node.remove(key)
    for key, value in given.items():
        if key not in node:
            node.add(key, _tables(key, value) if _is_table(value) else _item(value))
        elif isinstance(node[key], Mapping) and isinstance(value, Mapping):
            _edit(node[key], value)
        elif _is_table(value) and isinstance(node[key], AoT) and len(node[key]) == len(value):
            for part, content in zip(node[key], value, strict=True):
                _edit(part, content)
        elif not _same(node[key], value):
            node[key] = _tables(key, value) if _is_table(value) else _item(value)


def _same(one: Any, other: Any) -> bool:
    """Whether two values are, 1 and 1.0 alike but 1 and true not."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other) and isinstance(one, bool) == isinstance(other, bool)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) or (isinstance(value, list) and bool(value) and isinstance(value[0], Mapping))


def _tables(path: str, content: Any, meaning: Callable[[str, str], str | None] = lambda table, key: None) -> Item:
    """A table, or several of one name."""
    if isinstance(content, list):
        return AoT([_table(path, each, meaning) for each in content])
    return _table(path, content, meaning)


def _table(path: str, content: Mapping[str, Any], meaning: Callable[[str, str], str | None]) -> Table:
    table = tomlkit.table()
    nested = {key: value for key, value in content.items() if _is_table(value)}
    for key, value in content.items():
        if key in nested or value is None:
            continue
        item, told = _item(value), meaning(path, key)
        length = len(f"{key} = {item.as_string()}")
        if told and length < MARGIN:
            item.comment(told)
            item.trivia.comment_ws = " " * max(1, COLUMN - length)
        table.add(key, item)
    for key, value in nested.items():
        table.add(key, _tables(f"{path}.{key}", value, meaning))
    return table


def _item(value: Any) -> Item:
    """A value; lists are laid out here because the library takes the square of their length."""
    if not isinstance(value, list):
        item: Item = tomlkit.item(value)
        return item
    parts: list[Item] = []
    for each in value:
        parts += [_item(each), Whitespace(", ")]
    return Array(parts[:-1], Trivia())
