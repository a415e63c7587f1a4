"""A mistake in the form of a project file, in the words of the file."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from foreswitch._helpers.text import nearest
from foreswitch.project.tables import SUBTABLES, File, ReferenceTable, Table, Valve

__all__ = ["validated"]


def validated(content: dict[str, Any]) -> File:
    """The tables, or one complaint."""
    try:
        return File.model_validate(content)
    except ValidationError as error:
        raise ValueError(_sentence(error, content)) from None


def _sentence(error: ValidationError, content: dict[str, Any]) -> str:
    """One complaint in one sentence, its place in the words of the file."""
    # a union reports every branch that failed; an unknown or missing key says most, then what lies deepest
    ranks = {"extra_forbidden": 0, "missing": 1}
    detail = min(error.errors(include_url=False), key=lambda item: (ranks.get(item["type"], 2), -len(item["loc"])))
    path: list[str] = []
    found: list[tuple[Any, type[Table]]] = []  # for each part: what it holds, and the table it is a key of
    value: Any = content
    table: type[Table] = File
    for part in detail["loc"]:
        if isinstance(value, dict) and part in value:
            value = value[part]
            path.append(str(part))
            found.append((value, table))
            table = SUBTABLES.get(str(part), table)
        elif isinstance(part, int) and isinstance(value, list):
            value = value[part]
            table = ReferenceTable if table is Valve else table  # a list of disturbances: each has a course
    key = str(detail["loc"][-1])
    if detail["type"] == "missing":
        return f"[{'.'.join(path)}] has no key {key!r}; add it" if path else f"table [{key}] is missing; add it"
    place = f"[{'.'.join(path[:-1])}]" if path[:-1] else "the file"
    if detail["type"] == "extra_forbidden":
        return f"{place} has an unknown {'key' if path[:-1] else 'table'} {key!r}; {nearest(key, table.model_fields)}"
    while path[-1] not in found[len(path) - 1][1].model_fields:
        path.pop()
    value, table = found[len(path) - 1]
    description = table.model_fields[path[-1]].description
    if detail["type"] == "literal_error":
        meaning = f"give {detail['ctx']['expected']}"
    else:
        meaning = f"it holds: {description}" if description else "give a table"
    return f"{'.'.join(path)} is {value!r}; {meaning}"
