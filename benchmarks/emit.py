"""A design as C source: for programs that are counted or timed without Python."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foreswitch import Controller

C_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "d": "double", "f": "float"}
#: In the order of the binding.
SIZES = "states inputs outputs disturbances order rows candidates bad_limit measured loads gate_limit"
ARRAYS = """level_count pending holds exact_levels levels candidate safe state_row disturbance_row offset reference_row
half_weight pending_table hold_row total_row rest_reference rest_disturbance rest_offset dwell switch_cost model_x
model_old model_new model_w model_c gain output_row output_offset start_row start_offset gate"""
HORIZON_SIZES = "steps moves states order lead terminal tail exclusive dominance patience node_budget"
HORIZON_ARRAYS = """start_row start_disturbance start_offset pending_table drift drift_disturbance row_disturbance
row_offset reference_row terminal_reference terminal_disturbance terminal_offset F G S root_weight T move_weight lift
lift_centre last_value hull value effect gain gain_previous pull place from_place metric from_metric switch_cost level
dwell"""


def numbers(values: np.ndarray) -> str:
    """An initialiser; C has no empty one."""
    words = (f"{v:.17g}" if values.dtype.kind == "f" else str(v) for v in values.ravel())
    return f"{{{', '.join(words) or '0'}}}"


def structure(
    kind: str, name: str, sizes: Mapping[str, Any], arrays: Mapping[str, Any], absent: str = "", prefix: str = ""
) -> str:
    """A constant C structure and the arrays it points to."""
    lines, members = [], [f".{key} = {size}" for key, size in sizes.items()]
    for key, values in arrays.items():
        lines.append(f"static const {C_TYPES[values.dtype.char]} {prefix}{key}[] = {numbers(values)};")
        members += [f".{key} = {prefix}{key}"] if key != absent else []
    return "\n".join([*lines, f"static const {kind} {prefix}{name} = {{{', '.join(members)}}};\n"])


def named(names: str, values: Sequence[Any]) -> dict[str, Any]:
    return {key: value for key, value in zip(names.split(), values, strict=True) if value is not None}


def design_sizes(law: Controller) -> dict[str, int]:
    return named(SIZES, law._parts[0])


def design_source(law: Controller, prefix: str = "") -> str:
    """``static const fsw_design <prefix>design``; with one, its horizon."""
    _, values, horizon = law._parts
    sizes: dict[str, Any] = design_sizes(law)
    text = ""
    if horizon is not None:
        scalars, far, tables = horizon
        shared = {key: sizes[key] for key in ("inputs", "outputs", "candidates", "disturbances")}
        own = named(HORIZON_SIZES, scalars) | shared | {"far": f"{far:.17g}"}
        text = structure("fsw_horizon", "horizon", own, named(HORIZON_ARRAYS, tables), prefix=f"{prefix}h_")
        sizes |= {"horizon": f"&{prefix}h_horizon"}
    arrays = {key: np.atleast_1d(array) for key, array in named(ARRAYS, values).items()}
    return text + structure("fsw_design", "design", sizes, arrays, absent="exact_levels", prefix=prefix)
