"""Mistakes in the form of a project file, in the words of the file."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from foreswitch._helpers.mistake import Mistake, shown
from foreswitch._helpers.text import nearest
from foreswitch.project.tables import SUBTABLES, File, ReferenceTable, Table, Valve

__all__ = ["validated"]


def validated(content: dict[str, Any]) -> File:
    """The tables, or one mistake."""
    try:
        return File.model_validate(content)
    except ValidationError as error:
        raise _mistake(error, content) from None


def _mistake(error: ValidationError, content: dict[str, Any]) -> Mistake:
    """The worst of what does not fit, its place in the words of the file."""
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
            if isinstance(value, dict):  # one of several tables
                path.append(str(part))
                found.append((value, table))
            table = ReferenceTable if table is Valve else table  # a list of disturbances: each has a course
    key = str(detail["loc"][-1])
    if detail["type"] == "missing":
        place = ".".join([*path, key])
        if not path:
            return Mistake(key, None, "add it", problem="is missing", subject=f"table [{key}]", key=place)
        return Mistake(key, None, "add it", problem=f"has no key {key!r}", subject=f"[{'.'.join(path)}]", key=place)
    if detail["type"] == "extra_forbidden":
        subject, kind = (f"[{'.'.join(path[:-1])}]", "key") if path[:-1] else ("the file", "table")
        problem, remedy = f"has an unknown {kind} {shown(key)}", nearest(key, found[-1][1].model_fields)
        return Mistake(key, value, remedy, problem=problem, subject=subject, key=".".join(path))
    while path[-1] not in found[len(path) - 1][1].model_fields:
        path.pop()
    value, table = found[len(path) - 1]
    description = table.model_fields[path[-1]].description
    if detail["type"] == "literal_error":
        remedy = f"give {detail['ctx']['expected']}"
    else:
        remedy = f"it holds: {description}" if description else "give a table"
    return Mistake(path[-1], value, remedy, subject=".".join(path), key=".".join(path))
