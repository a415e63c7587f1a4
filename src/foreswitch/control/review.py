"""The design review: what the core cannot hold, and what a user should know of a design before it runs."""

from __future__ import annotations

import warnings
from typing import Any

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import nearest
from foreswitch.control.actuator import LONGEST_HOLD, Actuator
from foreswitch.control.kalman import Kalman
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model.plant import Plant

__all__ = ["check_kinds", "check_sizes", "warn_of_short_prediction"]


def check_kinds(plant: Any, objective: Any, estimator: Any, real: Any) -> None:
    """Whether each is of a kind that a controller is made of."""
    if not isinstance(plant, Plant):
        problem = f"is a {type(plant).__name__}"
        raise Mistake("plant", plant, "give a Plant, see Plant.from_control", problem=problem)
    if not isinstance(objective, (Endpoint, Horizon)):
        raise Mistake("objective", objective, "give an Endpoint or a Horizon")
    if not (estimator is None or isinstance(estimator, Kalman)):
        raise Mistake("estimator", estimator, "give a Kalman, or nothing where the state is measured")
    if real not in CORES:
        raise Mistake("real", real, nearest(str(real), CORES))


def warn_of_short_prediction(actuator: Actuator, reach: float, name: str, stacklevel: int) -> None:
    """Where a dwell outlasts the prediction: ``reach`` seconds, which the user calls ``name``."""
    longest = max(max(row) for row in actuator.dwell_seconds)
    if longest > reach * (1.0 + 1e-9):
        warnings.warn(
            f"min_on or min_off of {longest:g} s exceeds {name} = {reach:g} s: a switch is judged before it may be "
            f"taken back; consider a longer {name.removeprefix('the ')}",
            UserWarning,
            stacklevel=stacklevel + 1,
        )


def check_sizes(plant: Plant, loads: int, actuator: Actuator, Ts: float, reach: float, real: str) -> None:
    """What the core can hold; before the design, which would take as long as it is large.

    Raises
    ------
    ValueError
        If something is larger.
    """
    core = CORES[real]
    longest = float(plant.input_delay.max())
    depth = check.periods(longest, Ts) + 1
    holds = min(max(map(max, actuator.dwell)), check.periods(longest + reach, Ts))
    line = min(core.MAX_LINE, LONGEST_HOLD)
    for argument, size, limit, what in (
        ("plant", plant.states, core.MAX_STATES, "states"),
        ("plant", plant.inputs, core.MAX_INPUTS, "inputs"),
        ("plant", plant.outputs, core.MAX_OUTPUTS, "outputs"),
        ("E", plant.disturbances + loads, core.MAX_DISTURBANCES, "disturbances and loads"),
        ("input_delay", depth * plant.inputs, line, "periods of dead time (times inputs)"),
        ("min_on", holds, LONGEST_HOLD, "periods of dwell within the horizon"),
    ):
        if size > limit:
            remedy = f"the core holds up to {limit}, perhaps with a longer Ts"
            raise Mistake(argument, size, remedy, problem=f"has {size} {what}", subject="plant")
