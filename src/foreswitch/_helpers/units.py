"""Units of quantities: declared beside a key, or in square brackets behind a name, ``"pressure [kPa]"``."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["INDEPENDENT", "NO_UNIT", "described", "name_and_unit", "rate_unit", "unit_of_names", "without_units"]

#: Units that do not depend on what a plant's states, inputs and outputs are measured in.
INDEPENDENT = frozenset({"s", "1/s", "Hz", "rad", "rad/s"})
#: How a name says that its quantity has none.
NO_UNIT = ("", "-", "1")


def name_and_unit(name: str) -> tuple[str, str]:
    """What "pressure [kPa]" consists of; the unit is empty where none is given."""
    hit = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]\s*", name, flags=re.DOTALL)
    return (hit[1], " ".join(hit[2].split())) if hit else (name, "")


def unit_of_names(names: Sequence[str]) -> str:
    """The unit that these names share, else one each; empty where they have none."""
    found = [name_and_unit(name)[1] for name in names]
    if all(unit in NO_UNIT for unit in found):
        return ""
    return found[0] if len(set(found)) == 1 else ", ".join(unit or "1" for unit in found)


def described(meaning: str, unit: str | None = None, note: str = "") -> str:
    """A quantity in a sentence: what it is, its unit, and what there is to say besides."""
    return f"{meaning} [{unit}]{note}" if unit else f"{meaning}{note}"


def rate_unit(unit: str, order: int = 1) -> str:
    """The unit of a derivative: of the first "kPa/s", of the second "kPa/s^2"."""
    return (unit or "1") + ("" if order == 0 else "/s" if order == 1 else f"/s^{order}")


def without_units(summary: Mapping[str, Any]) -> dict[str, Any]:
    """A summary whose keys say their units, as a program asks for it: under the names alone, the units in a table beside."""
    units: dict[str, str] = {}

    def bare(value: Any) -> Any:
        if isinstance(value, list):
            return [bare(item) for item in value]
        if not isinstance(value, Mapping):
            return value
        found = {}
        for key, item in value.items():
            name, unit = name_and_unit(key)
            if unit:
                units[name] = unit
            found[name] = bare(item)
        return found

    result: dict[str, Any] = bare(summary)
    return result | ({"units": units} if units else {})
