"""A design as one C header: sizes for the core's limits, and its tables. Data only, never logic."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from foreswitch._binding import REALS
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.design import Design, HorizonDesign, Tables

__all__ = ["exported", "initialiser", "limits", "limits_text", "number", "tables_text"]

WIDTH = 118


def number(value: Any) -> str:
    """A C constant: the shortest that reads back as the same number; floats of single precision end in f."""
    if isinstance(value, np.floating):
        single = value.dtype == np.float32
        text = str(value) if single else repr(float(value))
        if "." not in text and "e" not in text:
            text += ".0"
        return f"{text}f" if single else text
    return f"{value}u" if value > 32767 else str(value)


def initialiser(values: Iterable[Any], indent: int = 4) -> str:
    """``{...}``, wrapped; C knows no empty one."""
    words = [number(value) for value in values] or ["0"]
    if sum(map(len, words)) + 2 * len(words) < 60:
        return f"{{{', '.join(words)}}}"
    lines, line = [], " " * indent
    for word in words:
        if len(line) + len(word) + 2 > WIDTH:
            lines.append(line.rstrip())
            line = " " * indent
        line += f"{word}, "
    return "\n".join(["{", *lines, line.rstrip(" ,") + "}"])


def exported(design: Design) -> Design:
    """The design as firmware has it: what is always zero is left out.

    Raises
    ------
    ValueError
        If a number is not finite in the design's arithmetic: C has no constant for it, and no use.
    """
    if design.horizon is None and _rests_at_zero(design):
        design = replace(design, rest_reference=None, rest_disturbance=None, rest_offset=None)
    for part in (design, design.horizon):
        for each in part.tables() if part else ():
            values = getattr(part, each.name)
            if values is not None and not np.isfinite(values).all():
                problem = f"is {design.real!r}, in which the design's {each.name} overflows"
                remedy = "choose smaller weights, or units of which the plant moves fewer"
                raise Mistake("real", design.real, remedy, problem=problem)
    return design


def _rests_at_zero(design: Design) -> bool:
    """Whether the tail is always zero, as with a plant that integrates: then the core need not compute it."""
    rest = design.rest_reference, design.rest_disturbance, design.rest_offset
    if any(values is None or values.any() for values in rest):
        return False
    return all(each[0] <= 0.0 <= each[-1] for each in np.split(design.levels, np.cumsum(design.level_count)[:-1]))


def limits(design: Design) -> dict[str, int]:
    """The core's macros: sizes as they are, and what is not used."""
    h = design.horizon
    sizes = {
        "FSW_MAX_STATES": design.states, "FSW_MAX_INPUTS": design.inputs, "FSW_MAX_OUTPUTS": design.outputs,
        "FSW_MAX_DISTURBANCES": max(design.disturbances, 1), "FSW_MAX_LINE": design.rows * design.inputs,
    }  # fmt: skip
    if h is not None:
        sizes |= {
            "FSW_MAX_MOVES": h.moves, "FSW_MAX_STEPS": h.steps, "FSW_HORIZON_STATES": h.states,
            "FSW_HORIZON_CANDIDATES": design.candidates,
        }  # fmt: skip
        sizes |= {} if h.dominance else {"FSW_RECORDS": 0}
    endpoint = h is None
    return sizes | {
        "FSW_DISTURBANCES": design.disturbances, "FSW_LOADS": design.loads, "FSW_ORDER": design.order,
        "FSW_CANDIDATES": design.candidates, "FSW_ESTIMATOR": int(design.gain is not None),
        "FSW_REST": int(design.rest_reference is not None),
        "FSW_SWITCH_COST": int(endpoint and design.switch_cost.any()),
        "FSW_OFFSET": int(design.offset is not None and design.offset.any()),
        "FSW_SPLIT": int(design.model_new.any()),
        "FSW_HELD_ONCE": int(endpoint and (design.holds == 1).all()),
    }  # fmt: skip


def limits_text(design: Design, name: str) -> str:
    """The first section: what foreswitch.h asks for."""
    lines = ["#define FSW_SINGLE /* fsw_real is float */"] if design.real == "float32" else []
    lines += ["#define FSW_FIXED", *(f"#define {key} {value}" for key, value in limits(design).items())]
    return "\n".join([*lines, f"#define FSW_DESIGN {name}"])


def tables_text(design: Design, name: str) -> str:
    """The last section: constant tables and the structures that point to them."""
    text, horizon = "", "0"
    if design.horizon is not None:
        text = _structure(design.horizon, f"static const fsw_horizon {name}_horizon", f"{name}_horizon_") + "\n"
        horizon = f"&{name}_horizon"
    return text + _structure(design, f"const fsw_design {name}", f"{name}_", horizon=horizon)


def _structure(part: Design | HorizonDesign, head: str, prefix: str, **pointers: str) -> str:
    """Its arrays, and the structure, members in the order of C, which C++ insists on; what does not apply is null."""
    arrays, members = "", ""
    for each in fields(part):
        kind = each.metadata.get("kind")
        value = getattr(part, each.name)
        if kind is None or each.metadata.get("host"):
            spelled = pointers.get(each.name)
        elif each.metadata["shape"] is None:
            spelled = number(REALS[part.real](value) if kind == "fsw_real" else value)
        elif _is_absent(part, each.name):
            spelled = "0"
        else:
            arrays += f"static const {kind} {prefix}{each.name}[] = {initialiser(value)};\n"
            spelled = f"{prefix}{each.name}"
        if spelled is not None:
            members += f"    .{each.name} = {spelled},\n"
    return f"{arrays}\n{head} = {{\n{members}}};\n"


def _is_absent(part: Tables, name: str) -> bool:
    """Whether a table does not apply: a horizon does not read the holding times."""
    values = getattr(part, name)
    return values is None or (name == "holds" and not values.any())
