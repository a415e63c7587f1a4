"""Where a controller starts: commands under way, running dwell, a known state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch.control.actuator import Actuator, level_indices
from foreswitch.model.plant import Plant

__all__ = ["commands_under_way", "known_state", "running_dwell"]


def commands_under_way(
    actuator: Actuator, steps: int, pending: ArrayLike | None
) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Level indices (steps + 1, m), oldest first: those given, the first one repeated, or the safe ones.

    Raises
    ------
    ValueError
        If a row is missing or is not an allowed command.
    """
    m, depth = len(actuator.levels), steps + 1
    if pending is None:
        return np.array([actuator.safe] * depth, dtype=np.uint8)
    values = check.array("pending", pending)
    if values.ndim < 2:
        values = values.reshape(-1, 1) if m == 1 else values.reshape(1, -1)
    if values.ndim != 2 or values.shape[1] != m or len(values) < steps:
        remedy = f"give at least {steps} row(s) of {m} level(s)"
        raise Mistake("pending", pending, remedy, problem=f"has shape {np.shape(pending)}")
    given = [level_indices("pending", row, actuator.levels) for row in values[-depth:]]
    allowed = {tuple(command) for command in actuator.candidates.tolist()}
    for row in given:
        if tuple(row) not in allowed:
            level = [float(v[i]) for v, i in zip(actuator.levels, row, strict=True)]
            problem = f"holds the forbidden command {level}"
            raise Mistake("pending", pending, "start from an allowed one", problem=problem)
    given = given or [actuator.safe]
    return np.array([given[0]] * (depth - len(given)) + given, dtype=np.uint8)


def running_dwell(
    actuator: Actuator, Ts: float, present: Any, elapsed: ArrayLike | None
) -> np.ndarray[Any, np.dtype[np.uint32]]:
    """Periods (m,) that each input must still keep its present level, which it took ``elapsed`` seconds ago."""
    wait = np.zeros(len(actuator.levels), dtype=np.uint32)
    if elapsed is not None:
        since = check.per("elapsed", elapsed, len(actuator.levels), "input", least=0.0)
        for j, level in enumerate(present):
            wait[j] = check.periods(actuator.dwell_seconds[j][level] - since[j], Ts)
    return wait


def known_state(
    plant: Plant, loads: int, estimate: ArrayLike | None, load: ArrayLike | None, disturbance: ArrayLike | None
) -> tuple[Array, Array] | None:
    """A known state (n,), and the disturbances with the loads behind them; None where none is given.

    Raises
    ------
    ValueError
        If something else is given without a state, or a shape does not fit.
    """
    if estimate is None:
        for name, value in (("load", load), ("disturbance", disturbance)):
            if value is not None:
                raise Mistake(name, value, "give estimate too", problem=f"is {shown(value)} without a state")
        return None
    x = check.array("estimate", estimate, (plant.states,))
    w = [
        np.zeros(size) if value is None else check.array(name, value, (size,), ndmin=1)
        for name, value, size in (("disturbance", disturbance, plant.disturbances), ("load", load, loads))
    ]
    return x, np.concatenate(w)
