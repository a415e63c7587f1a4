"""What each field of the page means, read off the tables of a project file."""

from __future__ import annotations

import types
import typing
from typing import Any

from foreswitch.project.tables import TABLES, Choice, unit_of

__all__ = ["schema", "uses"]

KINDS = {float: "number", int: "integer", str: "text", bool: "boolean"}


def schema() -> dict[str, dict[str, Any]]:
    """Every key, "actuator.Ts", with description, unit, type, choices, default and whether it is required."""
    found = {}
    for name, table in TABLES.items():
        for key, field in table.model_fields.items():
            kinds, choices = _kinds(field.annotation)
            required = field.is_required()
            found[f"{name}.{key}"] = {
                "description": field.description or "",
                "unit": unit_of(field),
                "type": kinds[0] if len(kinds) == 1 else "any",
                "types": kinds,
                **({"choices": choices} if choices else {}),
                "default": None if required else field.default,
                "required": required,
            }
    return found


def uses() -> dict[str, Any]:
    """Tables in which one key decides which others are used: that key, and the others by its value."""
    return {
        name: {
            "by": table.BY,
            "uses": {c: {"needed": list(must), "optional": list(may)} for c, (must, may) in table.USES.items()},
            "always": list(table.ALWAYS),
        }
        for name, table in TABLES.items()
        if issubclass(table, Choice)
    }


def _kinds(annotation: Any) -> tuple[list[str], list[Any]]:
    """What a key may hold, in words, and its choices."""
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        parts = [_kinds(each) for each in typing.get_args(annotation) if each is not type(None)]
        return list(dict.fromkeys(kind for kinds, _ in parts for kind in kinds)), [c for _, cs in parts for c in cs]
    if typing.get_origin(annotation) is typing.Literal:
        return ["choice"], list(typing.get_args(annotation))
    if typing.get_origin(annotation) is list:
        return ["list"], []
    return [KINDS.get(annotation, "table")], []
