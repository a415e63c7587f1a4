"""A design as C source: for programs that are counted or timed without Python."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from foreswitch import Controller
from foreswitch.control.design import Tables

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


def design_sizes(law: Controller) -> dict[str, Any]:
    return sizes(law.design)


def sizes(part: Tables) -> dict[str, Any]:
    found = {each.name: getattr(part, each.name) for each in part.scalars()}
    return {name: f"{value:.17g}" if isinstance(value, float) else value for name, value in found.items()}


def arrays(part: Tables) -> dict[str, np.ndarray]:
    found = {each.name: getattr(part, each.name) for each in part.tables()}
    return {name: values for name, values in found.items() if values is not None}


def design_source(law: Controller, prefix: str = "") -> str:
    """``static const fsw_design <prefix>design``; with one, its horizon."""
    design, horizon = law.design, law.design.horizon
    text, pointer = "", {}
    if horizon is not None:
        text = structure("fsw_horizon", "horizon", sizes(horizon), arrays(horizon), prefix=f"{prefix}h_")
        pointer = {"horizon": f"&{prefix}h_horizon"}
    own = sizes(design) | pointer
    return text + structure("fsw_design", "design", own, arrays(design), absent="exact_levels", prefix=prefix)
