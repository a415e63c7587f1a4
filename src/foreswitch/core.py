"""The C core as Python sees it; the only module that touches the extension modules."""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from foreswitch import _core_float32, _core_float64, prediction
from foreswitch.plant import Plant

__all__ = ["CORES", "REALS", "core_plant"]

CORES: dict[str, ModuleType] = {"float64": _core_float64, "float32": _core_float32}
REALS: dict[str, type[np.floating[Any]]] = {"float64": np.float64, "float32": np.float32}


@lru_cache(maxsize=64)
def core_plant(plant: Plant, Ts: float, real: str) -> tuple[Any, int]:
    """A plant in the form the C loop steps (always in double), and its longest dead time in periods."""
    model = prediction.period_model(plant, Ts)
    sizes = (plant.states, plant.inputs, plant.outputs, plant.disturbances)
    delay = np.array(model.delay, dtype=np.uint32)
    arrays = (model.transition, model.old, model.new, model.load, model.disturbance, model.drift, delay, plant.C,
              plant.y_offset)  # fmt: skip
    return CORES[real].Plant(sizes, tuple(np.ascontiguousarray(a) for a in arrays)), int(delay.max())
