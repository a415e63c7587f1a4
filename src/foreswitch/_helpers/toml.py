"""TOML: tables as the text of a file, with comments above and behind."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import tomlkit
from tomlkit.items import AoT, Array, Item, Table, Trivia, Whitespace

__all__ = ["toml_text"]

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
