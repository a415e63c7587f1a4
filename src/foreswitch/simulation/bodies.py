"""Plants, rigs and sensors in the form in which the C loop steps them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch.model import hardware, prediction
from foreswitch.model.hardware import Hardware
from foreswitch.model.nonlinear import SteppedPlant
from foreswitch.model.plant import Plant

__all__ = ["core_plant", "core_rig", "core_sensor"]

#: Pieces of constant parameters that a drift over one run is made of.
DRIFT_PIECES = 100


@lru_cache(maxsize=64)
def core_plant(plant: Plant, Ts: float, real: str) -> tuple[Any, int]:
    """A plant in the form the C loop steps (always in double), and its longest dead time in periods."""
    model = prediction.period_model(plant, Ts)
    tables = {
        "transition": model.transition, "input_old": model.old, "input_new": model.new, "input_load": model.load,
        "disturbance": model.disturbance, "drift": model.drift, "delay": np.array(model.delay, dtype=np.uint32),
        "output": plant.C, "output_zero": plant.y_offset,
    }  # fmt: skip
    tables = {name: np.ascontiguousarray(values) for name, values in tables.items()}
    return CORES[real].Plant(_sizes(plant) | tables), max(model.delay)


def _sizes(plant: Plant | SteppedPlant) -> dict[str, Any]:
    return {
        "states": plant.states, "inputs": plant.inputs, "outputs": plant.outputs, "disturbances": plant.disturbances,
    }  # fmt: skip


def core_rig(plant: Plant | SteppedPlant, Ts: float, steps: int, what: Hardware) -> tuple[tuple[Any, ...], int]:
    """The parts of a rig, a plant behind real actuators, and the longest time a command is under way, in periods."""
    m = plant.inputs
    opening, closing = (check.per(name, getattr(what, name), m, "input") for name in ("opening", "closing"))
    cuts = hardware.segments(plant.input_delay, opening, closing, Ts)
    process = check.per("process_noise", what.process_noise, plant.states, "state") * np.sqrt(Ts)
    tables = _sizes(plant) | {
        "segments": cuts.count, "rise": cuts.rise, "fall": cuts.fall,
        "process": np.ascontiguousarray(process) if process.any() else None,
    }  # fmt: skip
    faults = hardware.stuck_periods(what.stuck, Ts, m)
    called, pieces, length = None, 1, steps
    if isinstance(plant, SteppedPlant):
        called = _callbacks(plant, cuts.edges, Ts)
    else:
        course = [plant]
        if what.drift is not None:
            length = -(-steps // min(steps, DRIFT_PIECES))
            pieces = -(-steps // length)
            course = [hardware.between(plant, what.drift, (i + 0.5) / pieces) for i in range(pieces)]
        models = [hardware.segment_models(each, cuts.edges) for each in course]
        names = ("transition", "input", "disturbance", "drift")
        linear = {name: np.array([item[i] for item in models]) for i, name in enumerate(names)}
        linear |= {"output": np.array([e.C for e in course]), "output_zero": np.array([e.y_offset for e in course])}
        tables |= {name: np.ascontiguousarray(values) for name, values in linear.items()}
    parts = (tables | {"pieces": pieces, "length": length}, faults, called)
    return parts, int(max(cuts.rise.max(), cuts.fall.max())) // cuts.count + 1


def _callbacks(plant: SteppedPlant, edges: Array, Ts: float) -> tuple[Any, Any]:
    """What the C loop calls for a plant that Python steps; all arguments are memory views."""
    lengths = np.diff(edges)

    def advance(k: int, x: memoryview, levels: memoryview, w: memoryview, following: memoryview) -> None:
        state: Array = np.frombuffer(x).copy()
        u = np.frombuffer(levels).reshape(len(lengths), -1)
        for i, length in enumerate(lengths):
            state = plant.advance(k * Ts + edges[i], state, u[i].copy(), np.frombuffer(w).copy(), length)
        np.frombuffer(following)[:] = state

    def output(x: memoryview, y: memoryview) -> None:
        np.frombuffer(y)[:] = plant.output(np.frombuffer(x).copy())

    return advance, output


def core_sensor(
    real: str, seen: int, measured: int, matrix: Array | None, deviation: Array | None, what: Hardware, Ts: float
) -> Any:
    """What stands between the plant's state or output and the law; None if nothing does."""
    quantum = check.per("quantum", what.quantum, measured, "measured value")
    low, high = hardware.sensor_range(what, measured)
    lost = what.missing > 0 or what.late > 0 or len(what.outages) > 0
    limited = quantum.any() or np.isfinite(low).any() or np.isfinite(high).any()
    if matrix is None and deviation is None and not lost and not limited:
        return None
    outages = np.array([[hardware.period(t, Ts) for t in window] for window in what.outages], dtype=np.uint64)
    return CORES[real].Sensor({
        "measured": measured, "seen": seen, "missing": float(what.missing), "late": what.late / Ts, "matrix": matrix,
        "deviation": deviation, "quantum": quantum, "low": low, "high": high,
        "outages": outages if len(outages) else None,
    })  # fmt: skip
