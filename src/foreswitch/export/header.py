"""A controller's design as one C header: sizes for the core's limits, and its tables. Data only, never logic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreswitch.control.controller import Controller

__all__ = ["Design", "initialiser", "number"]

# In the order of the binding.
SIZES = "states inputs outputs disturbances order rows candidates bad_limit measured loads gate_limit"
ARRAYS = """level_count pending holds exact_levels levels candidate safe state_row disturbance_row offset reference_row
half_weight pending_table hold_row total_row rest_reference rest_disturbance rest_offset dwell switch_cost model_x
model_old model_new model_w model_c gain output_row output_offset start_row start_offset gate"""
HORIZON_SIZES = "steps moves states order lead terminal tail exclusive dominance patience node_budget"
HORIZON_ARRAYS = """start_row start_disturbance start_offset pending_table drift drift_disturbance row_disturbance
row_offset reference_row terminal_reference terminal_disturbance terminal_offset F G S root_weight T move_weight lift
lift_centre last_value hull value effect gain gain_previous pull place from_place metric from_metric switch_cost level
dwell"""

# In the order of the C structures, which C++ insists on.
DESIGN = """states inputs outputs disturbances order rows candidates bad_limit measured loads gate_limit level_count levels
candidate safe state_row disturbance_row offset reference_row half_weight pending pending_table holds hold_row total_row
rest_reference rest_disturbance rest_offset dwell switch_cost model_x model_old model_new model_w model_c gain output_row
output_offset start_row start_offset gate horizon"""
HORIZON = """steps moves states inputs outputs candidates disturbances order lead terminal tail exclusive dominance patience
node_budget start_row start_disturbance start_offset pending_table drift drift_disturbance row_disturbance row_offset
reference_row terminal_reference terminal_disturbance terminal_offset far F G S root_weight T move_weight lift
lift_centre last_value hull value effect gain gain_previous pull place from_place metric from_metric switch_cost level
dwell"""

C_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "d": "fsw_real", "f": "fsw_real"}
WIDTH = 118
REST = ("rest_reference", "rest_disturbance", "rest_offset")


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


def _named(names: str, values: Sequence[Any]) -> dict[str, Any]:
    return dict(zip(names.split(), values, strict=True))


@dataclass
class Design:
    """A controller's numbers, by the names of core/foreswitch.h and core/horizon.h.

    Attributes
    ----------
    real : {"float64", "float32"}
    sizes, arrays : dict
        Of fsw_design; absent arrays are None.
    horizon_sizes, horizon_arrays : dict or None
        Of fsw_horizon.
    """

    real: str
    sizes: dict[str, int]
    arrays: dict[str, Any]
    horizon_sizes: dict[str, Any] | None
    horizon_arrays: dict[str, Any] | None

    @classmethod
    def of(cls, controller: Controller) -> Design:
        sizes, arrays, horizon = controller._parts
        design = cls(controller.real, _named(SIZES, sizes), _named(ARRAYS, arrays), None, None)
        del design.arrays["exact_levels"]
        if horizon is not None:
            own, far, tables = horizon
            shared = {key: design.sizes[key] for key in ("inputs", "outputs", "candidates", "disturbances")}
            kind = np.float32 if controller.real == "float32" else np.float64
            design.horizon_sizes = _named(HORIZON_SIZES, own) | shared | {"far": kind(far)}
            design.horizon_arrays = _named(HORIZON_ARRAYS, tables)
        elif design._rests_at_zero():
            design.arrays |= dict.fromkeys(REST)
        design._judge()
        return design

    def _judge(self) -> None:
        """C has no constant for what is not finite, and no use for it."""
        for key, values in (self.arrays | (self.horizon_arrays or {})).items():
            if values is not None and not np.isfinite(values).all():
                raise ValueError(
                    f"real is {self.real!r}, in which the design's {key} overflows; choose smaller weights, or units of "
                    "which the plant moves fewer"
                )

    def _rests_at_zero(self) -> bool:
        """Whether the tail is always zero, as with a plant that integrates: then the core need not compute it."""
        if self.arrays["rest_reference"] is None or any(self.arrays[key].any() for key in REST):
            return False
        levels = np.split(self.arrays["levels"], np.cumsum(self.arrays["level_count"])[:-1])
        return all(each[0] <= 0.0 <= each[-1] for each in levels)

    @property
    def limits(self) -> dict[str, int]:
        """The core's macros: sizes as they are, and what is not used."""
        s, a, h = self.sizes, self.arrays, self.horizon_sizes
        m = s["inputs"]
        limits = {
            "FSW_MAX_STATES": s["states"], "FSW_MAX_INPUTS": m, "FSW_MAX_OUTPUTS": s["outputs"],
            "FSW_MAX_DISTURBANCES": max(s["disturbances"], 1), "FSW_MAX_LINE": s["rows"] * m,
        }  # fmt: skip
        if h is not None and self.horizon_arrays is not None:
            limits |= {
                "FSW_MAX_MOVES": h["moves"], "FSW_MAX_STEPS": h["steps"], "FSW_HORIZON_STATES": h["states"],
                "FSW_HORIZON_CANDIDATES": s["candidates"],
            }  # fmt: skip
            limits |= {} if h["dominance"] else {"FSW_RECORDS": 0}
        limits |= {
            "FSW_DISTURBANCES": s["disturbances"], "FSW_LOADS": s["loads"], "FSW_ORDER": s["order"],
            "FSW_CANDIDATES": s["candidates"], "FSW_ESTIMATOR": int(a["gain"] is not None),
            "FSW_REST": int(a["rest_reference"] is not None),
        }  # fmt: skip
        endpoint = h is None
        return limits | {
            "FSW_SWITCH_COST": int(endpoint and a["switch_cost"].any()),
            "FSW_OFFSET": int(endpoint and a["offset"].any()),
            "FSW_SPLIT": int(a["model_new"].any()),
            "FSW_HELD_ONCE": int(endpoint and (a["holds"] == 1).all()),
        }

    @property
    def levels(self) -> list[list[float]]:
        """Of each input."""
        return [each.tolist() for each in np.split(self.arrays["levels"], np.cumsum(self.arrays["level_count"])[:-1])]

    def limits_text(self, name: str) -> str:
        """The first section: what foreswitch.h asks for."""
        lines = ["#define FSW_SINGLE /* fsw_real is float */"] if self.real == "float32" else []
        lines += ["#define FSW_FIXED", *(f"#define {key} {value}" for key, value in self.limits.items())]
        return "\n".join([*lines, f"#define FSW_DESIGN {name}"])

    def tables_text(self, name: str) -> str:
        """The last section: constant tables and the structures that point to them."""
        text = ""
        pointers: dict[str, str] = {"horizon": "0"}
        if self.horizon_sizes is not None and self.horizon_arrays is not None:
            prefix = f"{name}_horizon_"
            found = self._tables(self.horizon_arrays, prefix)
            members = self._spelled(self.horizon_sizes) | found[1]
            text += (
                found[0] + "\n" + self._structure(f"static const fsw_horizon {name}_horizon", HORIZON, members) + "\n"
            )
            pointers["horizon"] = f"&{name}_horizon"
        found = self._tables(self.arrays, f"{name}_")
        members = self._spelled(self.sizes) | found[1] | pointers
        return text + found[0] + "\n" + self._structure(f"const fsw_design {name}", DESIGN, members)

    @staticmethod
    def _spelled(sizes: Mapping[str, Any]) -> dict[str, str]:
        return {key: number(value) for key, value in sizes.items()}

    @staticmethod
    def _tables(arrays: Mapping[str, Any], prefix: str) -> tuple[str, dict[str, str]]:
        """Definitions, and what points to them; those that do not apply are null, none is empty."""
        text, pointers = "", {}
        for key, values in arrays.items():
            if values is None or (key == "holds" and not values.any()):
                pointers[key] = "0"
                continue
            text += f"static const {C_TYPES[values.dtype.char]} {prefix}{key}[] = {initialiser(values.ravel())};\n"
            pointers[key] = f"{prefix}{key}"
        return text, pointers

    @staticmethod
    def _structure(head: str, order: str, members: Mapping[str, str]) -> str:
        lines = "".join(f"    .{key} = {members[key]},\n" for key in order.split())
        return f"{head} = {{\n{lines}}};\n"
