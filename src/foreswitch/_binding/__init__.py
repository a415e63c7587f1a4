"""The C core as Python sees it: the extension modules, one per arithmetic, and nothing of what they are used for.

In: flat arrays of the core's own types. Out: the same, a status, a command. The C side is ``src/binding``; a design's
sizes and tables come from `foreswitch.control`, plants and sensors of a closed loop from `foreswitch.simulation`.
"""

from types import ModuleType
from typing import Any

import numpy as np

from foreswitch._binding import _core_float32, _core_float64

__all__ = ["CORES", "REALS"]

CORES: dict[str, ModuleType] = {"float64": _core_float64, "float32": _core_float32}
REALS: dict[str, type[np.floating[Any]]] = {"float64": np.float64, "float32": np.float32}
