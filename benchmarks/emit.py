"""A design as C source: for programs that are counted or timed without Python."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foreswitch import Controller
from foreswitch.export.header import ARRAYS, HORIZON_ARRAYS, HORIZON_SIZES, SIZES

C_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "d": "double", "f": "float"}


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
