"""Units of quantities: declared beside a key, or in square brackets behind a name, ``"pressure [kPa]"``."""

import re
from collections.abc import Sequence

__all__ = ["INDEPENDENT", "described", "name_and_unit", "per_second", "units_of"]

#: Units that do not depend on what a plant's states, inputs and outputs are measured in.
INDEPENDENT = frozenset({"s", "1/s", "Hz", "rad", "rad/s"})


def name_and_unit(name: str) -> tuple[str, str]:
    """What "pressure [kPa]" consists of; the unit is empty where none is given."""
    hit = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]\s*", name, flags=re.DOTALL)
    return (hit[1], " ".join(hit[2].split())) if hit else (name, "")


def units_of(names: Sequence[str]) -> str | list[str] | None:
    """The unit that these names share, else one each; None where no name carries one."""
    found = [name_and_unit(name)[1] for name in names]
    if not any(found):
        return None
    return found[0] if len(set(found)) == 1 else found


def described(meaning: str, unit: str | None = None, note: str = "") -> str:
    """A quantity in a sentence: what it is, its unit, and what there is to say besides."""
    return f"{meaning} [{unit}]{note}" if unit else f"{meaning}{note}"


def per_second(unit: str, power: int = 1) -> str:
    """The unit of a rate of change: "kPa/s", of the second "kPa/s^2"."""
    return (unit or "1") + ("" if power == 0 else "/s" if power == 1 else f"/s^{power}")
